"""Entry point of the command and of ``python -m quantify_client``.

Interrupts are handled before anything else is imported: importing numpy and scipy takes half a
second, in which Ctrl-C is as likely as later.
"""

from __future__ import annotations

import signal
import sys

from .commands.process import Ending, ready_streams

__all__ = ["main"]


def main() -> int:
    """Run the command line and return its exit status."""
    interrupted = 128 + int(signal.SIGINT)
    ending = Ending()
    with ready_streams():
        try:
            with ending:
                from .cli import main as run

                status = run()
        except KeyboardInterrupt:
            print("quantify-client: error: interrupted", file=sys.stderr)
            status = interrupted
    if status == interrupted and ending.number is not None:
        return 128 + ending.number
    return status


if __name__ == "__main__":
    sys.exit(main())
