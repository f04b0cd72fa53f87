"""From sources to measurements: the only place that knows the order of the stages."""

from __future__ import annotations

from .control.account import convert_control
from .control.scale import scale
from .run import describe, measure

__all__ = ["convert_control", "describe", "measure", "scale"]
