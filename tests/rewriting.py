"""A move for clouds that are rewritten: a turn, a scale and a shift."""

from __future__ import annotations

from typing import Any

import numpy as np

from quantify_client.types import Bounds

ANGLE, FACTOR = 0.3, 1.0173
PIVOT = np.array([576_700.0, 5_188_140.0, 160.0])
SHIFT = np.array([120.25, -33.5, 7.125])
UTM = "EPSG:32615"


def moved(xyz: np.ndarray) -> np.ndarray:
    """Turn about the vertical, scale, shift: (N, 3)."""
    cos, sin = np.cos(ANGLE), np.sin(ANGLE)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    return FACTOR * (xyz - PIVOT) @ turn.T + PIVOT + SHIFT


def move(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> Any:
    return tuple(moved(np.column_stack([x, y, z])).T)


def box(xyz: np.ndarray) -> Bounds:
    return Bounds(*xyz.min(axis=0).tolist(), *xyz.max(axis=0).tolist())
