"""The nouns that travel between rooms, and into JSON.

Frozen dataclasses only. Lengths, areas and volumes are in metres unless a name says otherwise
(a cloud whose unit is unknown keeps its own; :attr:`Measurement.length_unit` then says so).
"""

from __future__ import annotations

from ..options import Options
from .alignment import Aligned, StableGround
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
    AreaFailure,
    AreaResult,
    Body,
    BudgetItem,
    Check,
    Epochs,
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
from .stage import PourPoint, Stage, StageLevel

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
    "Epochs",
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
    "PourPoint",
    "Proposal",
    "Relief",
    "ScaleObservation",
    "SCHEMA",
    "Scaled",
    "Scaling",
    "Slice",
    "StableGround",
    "Stage",
    "StageLevel",
    "Body",
    "Window",
    "document",
    "interval95",
    "plain",
    "warnings_json",
]
