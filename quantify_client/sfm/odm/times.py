"""When the photographs of an OpenDroneMap project were taken."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path
from typing import Optional, Tuple

from ...errors import CloudError
from ...files.reading import parsed_json, read_small
from .layout import CAMERA_BYTES, SHOTS

__all__ = ["times_of_photographs"]


def times_of_photographs(project: Path) -> Optional[Tuple[datetime, datetime]]:
    """Return the first and the last time in ``odm_report/shots.geojson``; None without any.

    It has seconds since 1970 for each photograph, 0 where the photograph does not say.
    """
    path = project / SHOTS
    try:
        data = read_small(path, most=CAMERA_BYTES, what="photographs", error=CloudError)
        document = parsed_json(data, SHOTS, what="photographs", error=CloudError)
        told = [each["properties"].get("capture_time") for each in document["features"]]
        seconds = [float(value) for value in told if isinstance(value, (int, float)) and value > 0]
        first, last = (
            datetime.fromtimestamp(value, timezone.utc) for value in (min(seconds), max(seconds))
        )
    except (CloudError, OSError, LookupError, TypeError, AttributeError, ValueError, OverflowError):
        return None
    return first, last
