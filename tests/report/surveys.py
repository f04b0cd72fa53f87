"""Measurements made from formulas: what the pictures, the page and the files are tested with."""

from __future__ import annotations

import math
from typing import Any, Callable, Dict, List, Optional, Tuple

import numpy as np
import shapely

from quantify_client.types import (
    AreaFailure,
    AreaResult,
    BudgetItem,
    Check,
    FloatArray,
    Measurement,
    Relief,
    Slice,
)

EASTING, NORTHING = 576700.0, 5188100.0  # UTM-sized: where the real data is
HOSTILE = "<script>alert(1)</script>"
FORMULA = "=cmd()"

Height = Callable[[FloatArray, FloatArray], FloatArray]


def cone(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.clip(6.0 * (1 - np.hypot(x - 20, y - 18) / 14), 0, None)


def pit(x: FloatArray, y: FloatArray) -> FloatArray:
    return -np.clip(3.0 * (1 - (np.hypot(x - 15, y - 15) / 10) ** 2), 0, None)


def relief(
    height: Height,
    polygon: Any,
    *,
    cell_m: float = 0.25,
    size_m: Tuple[float, float] = (44.0, 40.0),
    east: float = EASTING,
    north: float = NORTHING,
    gaps: float = 0.03,
) -> Relief:
    """A form on a plane that is tilted both ways, with noise, over the polygon (local metres)."""
    random = np.random.default_rng(3)
    nx, ny = (int(s / cell_m) for s in size_m)
    x, y = np.meshgrid((np.arange(nx) + 0.5) * cell_m, (np.arange(ny) + 0.5) * cell_m)
    above = height(x, y) + random.normal(0, 0.02, x.shape)
    elevation = 330 + 0.04 * x + 0.02 * y + above + 0.15 * np.sin(x / 5) * np.cos(y / 7)
    inside = shapely.contains_xy(polygon, x, y)
    elevation[np.hypot(x - size_m[0], y - size_m[1]) < 6] = np.nan
    measured = random.random(x.shape) > gaps
    measured[(x > 24) & (x < 27) & (y > 20) & (y < 24)] = False
    moved = shapely.transform(polygon, lambda xy: xy + np.array([east, north]))
    return Relief(
        east,
        north,
        cell_m,
        elevation,
        np.where(inside, above, np.nan),
        inside.astype(float),
        measured,
        shapely.to_wkb(moved),
    )


def slices_of(ground: Relief, height_m: float) -> List[Slice]:
    above = ground.above_base_m[np.isfinite(ground.above_base_m)]
    cell = ground.cell_m**2
    made = []
    for k in range(math.floor(above.min() / height_m), math.ceil(above.max() / height_m)):
        low, high = k * height_m, (k + 1) * height_m
        part = np.clip(above, low, high) - low if k >= 0 else np.clip(above, low, high) - high
        volume = float(part.sum() * cell)
        made.append(Slice(low + height_m / 2, height_m, abs(volume) / height_m, volume, 900))
    return made


def terrain(name: str, ground: Relief, *, height_m: float = 0.5, **changes: Any) -> AreaResult:
    slices = slices_of(ground, height_m)
    cut = sum(s.volume_m3 for s in slices if s.volume_m3 > 0)
    fill = -sum(s.volume_m3 for s in slices if s.volume_m3 < 0)
    above = ground.above_base_m[np.isfinite(ground.above_base_m)]
    polygon = shapely.from_wkb(ground.polygon_wkb)
    budget = (
        BudgetItem("survey", 2.1, 1.9, 0.4),
        BudgetItem("base", 4.8, 4.6, 1.1),
        BudgetItem("coverage", 0.7, 0.6, 0.1),
        BudgetItem("slicing", 0.0, 0.0, 0.0),
    )
    known: Dict[str, Any] = dict(  # noqa: C408
        name=name,
        volume_m3=cut - fill,
        cut_m3=cut,
        fill_m3=fill,
        std_m3=math.hypot(2.1, 4.8, 0.7),
        cut_std_m3=math.hypot(1.9, 4.6, 0.6),
        fill_std_m3=math.hypot(0.4, 1.1, 0.1),
        budget=budget,
        area_m2=polygon.area,
        surface_area_m2=polygon.area * 1.07,
        perimeter_m=polygon.length,
        min_z_m=float(np.nanmin(ground.elevation_m)),
        max_z_m=float(np.nanmax(ground.elevation_m)),
        max_height_m=float(above.max()),
        coverage=0.9683,
        points_used=184_321,
        points_left_out={"noise class": 1203, "withheld": 4},
        slice_height_m=height_m,
        slices=slices,
        base="plane",
        cell_m=ground.cell_m,
        checks=(Check("TIN prisms", cut - fill + 3.0),),
        relief=ground,
    )
    return AreaResult(**{**known, **changes})


def pile(name: str = "North pile", **changes: Any) -> AreaResult:
    ring = shapely.Point(20, 18).buffer(16.5, quad_segs=12)
    area = ring.difference(shapely.box(26, 8, 29, 11))
    return terrain(name, relief(cone, area), mass_t=2215.4, mass_std_t=61.0, **changes)


def hollow(name: str = "Grassy hollow", **changes: Any) -> AreaResult:
    area = shapely.Point(15, 15).buffer(13, quad_segs=6)
    ground = relief(pit, area, size_m=(30, 30), east=EASTING + 60, north=NORTHING + 25)
    rows = [
        terrain("", ground, base=base, volume_m3=-470.0 + k, relief=None)
        for k, base in enumerate(("triangulate", "plane", "average", 329.5))
    ]
    return terrain(name, ground, bases=rows, height_m=0.25, **changes)


def body(name: str = "Statue", **changes: Any) -> AreaResult:
    z = np.arange(40) * 0.05 + 0.025
    area = 0.8 * np.sin(np.pi * z / 2.0) ** 0.7
    known: Dict[str, Any] = dict(  # noqa: C408
        name=name,
        volume_m3=float(area.sum() * 0.05),
        cut_m3=None,
        fill_m3=None,
        std_m3=0.012,
        cut_std_m3=None,
        fill_std_m3=None,
        budget=(BudgetItem("slicing", 0.012),),
        area_m2=None,
        surface_area_m2=None,
        perimeter_m=None,
        min_z_m=0.0,
        max_z_m=2.0,
        max_height_m=2.0,
        coverage=None,
        points_used=100_000,
        points_left_out={},
        slice_height_m=0.05,
        slices=[Slice(float(m), 0.05, float(a), float(a) * 0.05, 2500) for m, a in zip(z, area)],
    )
    return AreaResult(**{**known, **changes})


def failure(name: str = HOSTILE) -> AreaFailure:
    return AreaFailure(name, "The polygon crosses itself near (576710, 5188139); redraw it.")


def measurement(*results: Any, crs: Optional[str] = "EPSG:32615", **changes: Any) -> Measurement:
    known: Dict[str, Any] = dict(  # noqa: C408
        source="brighton_beach/model.laz",
        crs=crs,
        length_unit="m",
        shape="terrain",
        method="surface",
        grid_scale_factor=0.99967,
        results=results,
        warnings=("The cloud has no ground classes: everything was measured.",),
        provenance={
            "version": "0.1.0",
            "options": {"area": "piles.geojson", "base": "plane", "density": 1.8},
            "input": [
                {"path": "brighton_beach/model.laz", "size": 53_811_204, "mtime": 1700000000}
            ],
            "started": "2026-05-04T10:11:12+00:00",
            "seconds": 3.217,
        },
    )
    return Measurement(**{**known, **changes})


def everything() -> Measurement:
    """A pile, a hollow, a hostile failure and a name that is a formula."""
    warned = ("3.2 % of the cells were interpolated.", f"odd text {HOSTILE}")
    return measurement(pile(), hollow(warnings=warned), failure(), pile(FORMULA))
