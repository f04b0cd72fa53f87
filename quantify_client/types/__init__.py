"""The nouns that travel between rooms, and into JSON.

Frozen dataclasses only. Lengths, areas and volumes are in metres unless a name says otherwise
(a cloud whose unit is unknown keeps its own; :attr:`Measurement.length_unit` then says so).
"""

from __future__ import annotations

from ..options import Options
from .arrays import FloatArray, IntArray
from .cloud import MAX_COORDINATE, Bounds, Chunk, CloudInfo, CrsPart, Faces, Window
from .control import ControlAccount
from .notice import Notice
from .results import (
    AreaFailure,
    AreaResult,
    BudgetItem,
    Check,
    Floor,
    Gap,
    Measurement,
    Relief,
    Slice,
    Solid,
)
from .scaling import ControlledPoint, DirectHeight, Matrix4, Scaled, ScaleObservation, Scaling

__all__ = [
    "MAX_COORDINATE",
    "AreaFailure",
    "AreaResult",
    "Bounds",
    "BudgetItem",
    "Check",
    "Chunk",
    "CloudInfo",
    "ControlAccount",
    "ControlledPoint",
    "CrsPart",
    "DirectHeight",
    "FloatArray",
    "Faces",
    "Floor",
    "Gap",
    "IntArray",
    "Matrix4",
    "Measurement",
    "Notice",
    "Options",
    "Relief",
    "ScaleObservation",
    "Scaled",
    "Scaling",
    "Slice",
    "Solid",
    "Window",
]
