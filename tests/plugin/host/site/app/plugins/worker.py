"""Functions into the queue, by their source text."""

from worker.celery import eval_async

__all__ = ["eval_async"]
