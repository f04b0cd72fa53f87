"""Clouds that state their CRS and units in one way or another.

Each holds a cone, radius 8 m, height 4 m, of 268.083 true m3, on a plane of 40 m x 40 m.
"""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any, Dict, List, Mapping, Sequence, Tuple

import laspy
import numpy as np

from quantify_client import measure

CONE = math.pi * 64 * 4 / 3
US_FT, FT = 1200 / 3937, 0.3048
MISSISSIPPI = (623_318.0, 386_335.0)  # metres of EPSG:26995; EPSG:2255 is the same in feet
IOWA = (500_000.0, 4_649_776.0)  # metres of UTM zone 15


def cone(count: int = 40_000) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-20, 20, (2, count))
    return x, y, 100.0 + np.maximum(0.0, 4.0 * (1 - np.hypot(x, y) / 8.0))


def geokeys(keys: Mapping[int, int], doubles: Mapping[int, float] = {}) -> List[laspy.VLR]:
    rows = [(key, 0, 1, value) for key, value in keys.items()]
    rows += [(key, 34736, 1, place) for place, key in enumerate(doubles)]
    head = struct.pack("<4H", 1, 1, 0, len(rows))
    data = head + b"".join(struct.pack("<4H", *row) for row in sorted(rows))
    records = [laspy.VLR("LASF_Projection", 34735, "", data)]
    if doubles:
        numbers = struct.pack(f"<{len(doubles)}d", *doubles.values())
        records.append(laspy.VLR("LASF_Projection", 34736, "", numbers))
    return records


def wkt_record(text: str) -> laspy.VLR:
    return laspy.VLR("LASF_Projection", 2112, "", text.encode())


def las(
    path: Path,
    place: Tuple[float, float],
    units: Tuple[float, float],
    records: Sequence[Any],
    version: str = "1.2",
) -> Path:
    """Write the cone at a place (metres), in units of so many metres for x and y, and for z."""
    x, y, z = cone()
    x, y, z = (x + place[0]) / units[0], (y + place[1]) / units[0], z / units[1]
    header = laspy.LasHeader(point_format=6 if version == "1.4" else 3, version=version)
    header.scales, header.offsets = [0.001] * 3, [np.floor(x.min()), np.floor(y.min()), 0.0]
    header.vlrs.extend(records)
    made = laspy.LasData(header)
    made.x, made.y, made.z = x, y, z
    made.write(str(path))
    return path


def circle(place: Tuple[float, float], unit: float = 1.0, radius: float = 12.0) -> Dict[str, Any]:
    turn = np.linspace(0.0, 2 * np.pi, 61)
    ring = np.column_stack([place[0] + radius * np.cos(turn), place[1] + radius * np.sin(turn)])
    ring[-1] = ring[0]
    geometry = {"type": "Polygon", "coordinates": [(ring / unit).tolist()]}
    return {"type": "Feature", "properties": {"name": "pile"}, "geometry": geometry}


def volume(source: Path, place: Tuple[float, float], unit: float = 1.0, **options: Any) -> Any:
    """Measure without grid correction: lengths on the ground are not what is asked about here."""
    options.setdefault("grid", True)
    return measure(source, area=circle(place, unit), base="plane", **options)


def holds(measurement: Any) -> bool:
    """Whether the volume is that of the cone: a wrong unit is off by far more than three sigma."""
    (result,) = measurement.results
    return abs(result.volume_m3 - CONE) <= 3.0 * result.std_m3
