"""From sources to measurements: the only place that knows the order of the stages."""

from __future__ import annotations

from .control import convert_control
from .run import describe, measure
from .scale import scale

__all__ = ["convert_control", "describe", "measure", "scale"]
