"""What the command and ``python -m quantify_client`` start: Ctrl-C counts from the first moment.

Reading numpy, scipy and matplotlib takes a second, in which an interrupt is as likely as later.
"""

from __future__ import annotations

import sys

__all__ = ["main"]


def main() -> int:
    """Run the command line and return its exit status."""
    try:
        from .cli import main as run

        return run()
    except KeyboardInterrupt:
        print("quantify-client: error: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
