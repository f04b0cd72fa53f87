"""Volumes with an honest error from OpenDroneMap outputs and other point clouds."""

from __future__ import annotations

from .errors import QuantifyError
from .pipeline import describe, measure
from .report import to_json, write_report
from .types import AreaFailure, AreaResult, Measurement, Options

__all__ = [
    "AreaFailure",
    "AreaResult",
    "Measurement",
    "Options",
    "QuantifyError",
    "describe",
    "measure",
    "to_json",
    "write_report",
]
