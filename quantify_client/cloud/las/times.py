"""When the points of a LAS or LAZ file were taken."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Optional

import laspy
import lazrs

__all__ = ["time_of_points"]

#: Adjusted standard GPS time counts seconds from here, less 10^9 (LAS 1.4 R15, table 4).
_GPS = datetime(1980, 1, 6, tzinfo=timezone.utc)
_LESS = 1e9


def time_of_points(path: Path) -> Optional[datetime]:
    """Return when the first point of a file was taken; None where the file does not say.

    Times within a week are none of these, nor is 0, which programs write for no time. Leap seconds
    are not counted.
    """
    try:
        with laspy.open(path) as file:
            encoding = file.header.global_encoding
            is_standard = encoding.gps_time_type == laspy.header.GpsTimeType.STANDARD
            has_times = "gps_time" in file.header.point_format.dimension_names
            if not (is_standard and has_times and file.header.point_count):
                return None
            points = file.read_points(1)
            seconds = float(points["gps_time"][0])
            return _GPS + timedelta(seconds=seconds + _LESS) if seconds else None
    except (laspy.errors.LaspyException, lazrs.LazrsError, OSError, ValueError, OverflowError):
        return None  # no such file, or a value that no calendar has
