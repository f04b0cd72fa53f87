"""JSON files that OpenDroneMap wrote and anybody may have changed: checked, then read.

Numbers are checked where they are used: ODM itself writes NaN into fields that nothing here reads.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, List, Mapping, Optional, Tuple

from ...errors import ControlError
from ...files.reading import count_values, parsed_json, read_small

__all__ = ["features", "is_number", "numbers", "read_object", "shown"]

MAX_BYTES = 100_000_000  # 140,000 photographs
_MAX_VALUES = 5_000_000  # in one file: each takes up to 80 bytes of memory, and two of the file
MAX_NUMBER = 1e9  # beyond any map in metres; products of two stay exact enough


def read_object(path: Path, expected: str) -> Mapping[str, Any]:
    """Read a file that holds one JSON object.

    Parameters
    ----------
    path : Path
    expected : str
        What the file should be, and where it comes from; ends the messages.

    Raises
    ------
    ControlError
        Not there, too large, no JSON, or no object; one line that names the file.
    """
    data = read_small(path, most=MAX_BYTES, what=expected, error=ControlError)
    if count_values(data) > _MAX_VALUES:
        raise ControlError(f"{path}: holds more than {_MAX_VALUES:,} values; expected {expected}")
    document: Any = parsed_json(data, path, what=expected, error=ControlError)
    if not isinstance(document, dict):
        raise ControlError(f"{path}: holds no JSON object; expected {expected}")
    return document


def features(path: Path, document: Mapping[str, Any], expected: str) -> List[Mapping[str, Any]]:
    """Return the features of a GeoJSON collection; ControlError where one has no properties."""
    found = document.get("features")
    if not isinstance(found, list) or not found:
        raise ControlError(f"{path}: has no features; expected {expected}")
    for number, feature in enumerate(found, start=1):
        if not isinstance(feature, dict) or not isinstance(feature.get("properties"), dict):
            raise ControlError(
                f"{path}: feature {number} has no properties; expected {expected}: download it "
                "again"
            )
    return found


def is_number(value: Any) -> bool:
    """Whether a JSON value is a finite number of a size that occurs; true and "1" are none."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    # Compared before it is converted: an integer of 400 digits does not fit a float.
    return -MAX_NUMBER <= value <= MAX_NUMBER and math.isfinite(value)


def numbers(value: Any, count: int) -> Optional[Tuple[float, ...]]:
    """Return `count` finite numbers; None when the value is anything else."""
    if not isinstance(value, list) or len(value) != count or not all(map(is_number, value)):
        return None
    return tuple(float(item) for item in value)


def shown(value: Any) -> str:
    """Return a text from a file, fit for a message of one line."""
    text = value if isinstance(value, str) else str(type(value).__name__)
    return "".join(c if c.isprintable() else "?" for c in text[:80])
