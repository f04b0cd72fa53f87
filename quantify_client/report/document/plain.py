"""Any value in the few types that JSON has."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Mapping

import numpy as np

from ..wording.words import encodable

__all__ = ["plain"]


def plain(value: Any) -> Any:
    """Return the value in JSON's own types; what has none (a geometry, a path) as text."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int)):
        return value
    if isinstance(value, float):
        # + 0.0: no "-0.0". 15 digits, which every decimal survives: no 0.30000000000000004.
        return float(f"{value:.15g}") + 0.0 if math.isfinite(value) else None
    if isinstance(value, str):
        return encodable(value)
    return _container(value)


def _container(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {encodable(str(key)): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item) for item in value]
    return encodable(str(value))
