"""The nouns that travel between rooms, and into JSON.

Frozen dataclasses only. Lengths, areas and volumes are in metres unless a name says otherwise
(a cloud whose unit is unknown keeps its own; :attr:`Measurement.length_unit` then says so).
"""

from __future__ import annotations

from ..options import Options
from .cloud import (
    MAX_COORDINATE,
    Bounds,
    Chunk,
    CloudInfo,
    CrsPart,
    Faces,
    FloatArray,
    IntArray,
    Window,
)
from .json_records import SCHEMA, document
from .notice import Notice
from .results import (
    INTERVAL95,
    Aligned,
    AreaFailure,
    AreaResult,
    Body,
    BudgetItem,
    Check,
    Floor,
    Gap,
    Measurement,
    Proposal,
    Relief,
    Scaled,
    Slice,
    interval95,
)
from .scaling import (
    ControlAccount,
    ControlledPoint,
    DirectHeight,
    Matrix4,
    ScaleObservation,
    Scaling,
)
from .shapes import plain, warnings_json

__all__ = [
    "INTERVAL95",
    "MAX_COORDINATE",
    "Aligned",
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
    "Proposal",
    "Relief",
    "ScaleObservation",
    "SCHEMA",
    "Scaled",
    "Scaling",
    "Slice",
    "Body",
    "Window",
    "document",
    "interval95",
    "plain",
    "warnings_json",
]
