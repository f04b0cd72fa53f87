"""Calls to WebODM's message broker, none of which keeps a request waiting.

Each has a connection of its own with limits of time. Those of Celery's pool have none: they wait
for ever for a broker that hangs, and the first use after it was restarted fails.
"""

import contextlib
import inspect
import itertools
import json
import time

__all__ = ["BrokerError", "enqueue", "holds"]

#: Time limits: of one step of a connection (a call has a few), and of a whole search.
_LIMIT_S, _WHOLE_S = 2.0, 5.0
_PAGE, _MOST_MESSAGES = 500, 20_000


class BrokerError(Exception):
    """The broker cannot be reached, or does not answer in time."""


def enqueue(function, *arguments, message):
    """Have WebODM's worker run a function, as WebODM's own `run_function_async` does.

    Parameters
    ----------
    function : callable
        Its source text is sent.
    *arguments
        Plain values.
    message : str
        The id of the message, a UUID.
    """
    from app.plugins.worker import eval_async

    with _connection() as (_, connection):
        # Nobody asks for the result, and following it would use a connection without time limits.
        eval_async.apply_async(
            (inspect.getsource(function), function.__name__, *arguments),
            task_id=message,
            connection=connection,
            retry=False,
            ignore_result=True,
        )


def holds(message):
    """Whether the broker still has a message, waiting or handed to a worker that has not begun.

    Raises
    ------
    BrokerError
        It cannot be known: the broker does not answer, is no Redis, or has too many messages.
    """
    with _connection() as (app, connection):
        channel = connection.default_channel
        client = getattr(channel, "client", None)
        if client is None:
            raise BrokerError("the broker is no Redis")
        wanted = json.dumps(message).encode()
        # Search the queue first: messages move from it to those handed to workers.
        waiting = itertools.chain.from_iterable(_pages(client, app.conf.task_default_queue))
        if any(wanted in text for text in waiting):
            return True
        if client.hlen(channel.unacked_key) > _MOST_MESSAGES:
            raise BrokerError("the broker has too many messages")
        return any(wanted in text for text in client.hvals(channel.unacked_key))


def _pages(client, queue):
    """Yield the messages of a queue; new ones come in front, so that none is passed over."""
    ends = time.monotonic() + _WHOLE_S
    for start in range(0, _MOST_MESSAGES, _PAGE):
        if time.monotonic() > ends:
            raise BrokerError("the broker is slow")
        page = client.lrange(queue, start, start + _PAGE - 1)
        if not page:
            return
        yield page
    raise BrokerError("the broker has too many messages")


@contextlib.contextmanager
def _connection():
    from worker.celery import app

    limits = {
        "socket_timeout": _LIMIT_S,
        "socket_connect_timeout": _LIMIT_S,
        "max_retries": 0,  # else it is tried for ever
    }
    try:
        with app.connection_for_write(
            connect_timeout=_LIMIT_S, transport_options=limits
        ) as connection:
            yield app, connection
    except BrokerError:
        raise
    except Exception as error:
        # Which exceptions there are depends on the broker and on versions of three packages.
        raise BrokerError(str(error)) from error
