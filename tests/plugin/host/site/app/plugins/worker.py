"""Functions into the queue, by their source text."""

import inspect

from worker.celery import eval_async


def run_function_async(func, *args, **kwargs):
    """Queue the text of a function; its name and arguments go with it as JSON."""
    return eval_async.delay(inspect.getsource(func), func.__name__, *args, **kwargs)
