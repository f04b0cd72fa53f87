"""Scale bars that were clicked on a map, as a control file with heights from the cloud."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from ..crs import Frame, measuring_frame, positions_to
from ..errors import ControlError
from ..pipeline.streaming import Progress, stream
from ..source import Source, open_source
from ..types import FloatArray, Options, Window

__all__ = ["bars_control"]

#: Points within this many mean spacings of a click give its height.
_REACH = 3.0

#: Standard deviation of a click, in local point spacings ...
_CLICK = 2.0

#: ... but at least this, which is what a map can show: metres.
_LEAST_CLICK_M = 0.02

_WGS84 = "OGC:CRS84"


def bars_control(
    cloud: Union[str, Path],
    bars: Sequence[Mapping[str, Any]],
    progress: Optional[Progress] = None,
    options: Optional[Options] = None,
) -> Dict[str, Any]:
    """Return a control file (to be written as JSON) for lengths between places clicked on a map.

    A click knows no height: each end gets the median height of the points around it. What that
    leaves open of a bar's slope goes into the bar's own accuracy, and the places' accuracy is two
    point spacings, for nobody clicks better than the cloud shows.

    Parameters
    ----------
    bars : mappings with ``from`` and ``to`` ([lon, lat], degrees), ``length_m``, ``accuracy_m``.
    options : the CRS and the units that the user gave.

    Raises
    ------
    ControlError
        The cloud has no CRS, or no points where an end was clicked.
    """
    report = progress or (lambda stage, share: None)
    given = options or Options()
    with open_source([cloud], options=given) as source:
        info = source.cloud.info
        frame = measuring_frame(info.crs, given.source_unit, info.bounds)
        if frame.grid is None or info.bounds is None:
            raise ControlError(
                "the cloud has no CRS, so places on a map are nowhere in it; give its CRS (--crs), "
                "or upload a control file with the cloud's own coordinates"
            )
        clicks = np.array([bar[end][:2] for bar in bars for end in ("from", "to")], dtype=float)
        own = frame.geographic_crs or frame.cloud_crs or ""
        x, y = positions_to(clicks[:, 0], clicks[:, 1], _WGS84, own)
        box = frame.bounds_to_frame(info.bounds)
        extent = (box.max_x - box.min_x) * (box.max_y - box.min_y)
        spacing = math.sqrt(extent / max(info.point_count or 1, 1))
        reach = _REACH * spacing
        heights = _heights(source, frame, x, y, reach, report)
    return _file(bars, np.column_stack([x, y]), heights, frame, reach)


def _heights(
    source: Source, frame: Frame, x: FloatArray, y: FloatArray, reach: float, report: Progress
) -> List[FloatArray]:
    """Return the heights of the cloud's points around each click, metres of the frame."""
    at = np.column_stack(frame.to_frame(x, y, np.zeros(len(x)))[:2])
    around = _Around(at, reach)
    for place in range(len(at)):
        window = Window(*(at[place] - reach), *(at[place] + reach))
        around.only = place
        stream(source.cloud, frame, around, frame.window_to_source(window), 1, report)
    return [np.concatenate(found) if found else np.zeros(0) for found in around.found]


class _Around:
    """Heights of points around places, one place at a time: tiles elsewhere are not read."""

    def __init__(self, places: FloatArray, reach: float) -> None:
        self.seen, self.only, self._places, self._reach = 0, 0, places, reach
        self.found: List[List[FloatArray]] = [[] for _ in places]

    def reduce(self, x: FloatArray, y: FloatArray, z: FloatArray) -> Tuple[int, FloatArray]:
        """Return the heights near the place."""
        east, north = self._places[self.only]
        return len(x), z[np.hypot(x - east, y - north) <= self._reach]

    def absorb(self, reduced: Tuple[int, FloatArray]) -> None:
        """Keep them."""
        self.seen += reduced[0]
        if len(reduced[1]):
            self.found[self.only].append(reduced[1])


def _file(
    bars: Sequence[Mapping[str, Any]],
    places: FloatArray,
    heights: Sequence[FloatArray],
    frame: Frame,
    reach: float,
) -> Dict[str, Any]:
    cloud: Dict[str, Any] = {}
    lengths = []
    for number, bar in enumerate(bars):
        names = [f"bar {number + 1}, {end}" for end in ("first end", "second end")]
        levels, spreads = [], []
        for name, place in zip(names, (2 * number, 2 * number + 1)):
            if not len(heights[place]):
                raise ControlError(
                    f"{name} was clicked where the cloud has no points; click on what it shows"
                )
            levels.append(float(np.median(heights[place])))
            spreads.append(float(np.std(heights[place])))
            xyz = [float(v) for v in places[place]] + [levels[-1] / frame.z_unit_m]
            # Local spacing: half of the cloud's box may be empty.
            spacing = reach * math.sqrt(math.pi / len(heights[place]))
            click_m = max(_CLICK * spacing, _LEAST_CLICK_M)
            cloud[name] = {"xyz": xyz, "accuracy": click_m / frame.unit_m}
        slope = _slope_std(levels[1] - levels[0], spreads, bar["length_m"])
        accuracy = math.hypot(bar["accuracy_m"], slope)
        lengths.append(
            {"from": names[0], "to": names[1], "length": bar["length_m"], "accuracy": accuracy}
        )
    return {"unit": "m", "cloud": cloud, "scale_bars": lengths}


def _slope_std(rise: float, spreads: Sequence[float], length: float) -> float:
    """Return what heights known to `spreads` do to a length: of first order, and of second."""
    variance = spreads[0] ** 2 + spreads[1] ** 2
    return math.hypot(rise / length * math.sqrt(variance), variance / (2.0 * length))
