"""From sources to measurements: the only place that knows the order of the stages."""

from __future__ import annotations

from .run import describe, measure

__all__ = ["describe", "measure"]
