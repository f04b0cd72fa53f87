"""Bodies measured by sections, made from formulas: what is drawn of them is known."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Callable, Dict, List, Sequence, Tuple

import numpy as np

from quantify_client.report.wording.units import THIN_SPACE
from quantify_client.types import (
    AreaResult,
    Body,
    BudgetItem,
    Check,
    FloatArray,
    Floor,
    Gap,
    Measurement,
    Slice,
)

from . import surveys

ORIGIN = (surveys.EASTING, surveys.NORTHING, 330.0)  # UTM-sized: where the real data is
Rings = List[FloatArray]


def circle(radius: float, x: float = 0.0, y: float = 0.0, count: int = 90) -> FloatArray:
    turn = np.linspace(0, 2 * math.pi, count, endpoint=False)
    return np.column_stack([x + radius * np.cos(turn), y + radius * np.sin(turn)])


def ball_rings(z: float) -> Rings:
    """A ball of radius 1 that stands on z = 0."""
    return [circle(math.sqrt(1 - (z - 1) ** 2))]


def torus_rings(z: float) -> Rings:
    """A lying torus, 1.5 and 0.5 in radius: two rings in each section, one in the other."""
    half = math.sqrt(0.25 - (z - 0.5) ** 2)
    return [circle(1.5 + half), circle(1.5 - half)]


def area_of(rings: Rings) -> float:
    """The area inside an odd number of nested rings."""
    areas = sorted((shoelace(ring) for ring in rings), reverse=True)
    return sum(area * (-1) ** i for i, area in enumerate(areas))


def shoelace(ring: FloatArray) -> float:
    x, y = ring.T
    return abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))) / 2


def body(
    name: str,
    rings_at: Callable[[float], Rings],
    height: float,
    area_at: Callable[[Rings], float] = area_of,
    *,
    slices: int = 40,
    points: int = 6_000,
    gaps: Sequence[Gap] = (),
    changes_of_body: Any = None,
    **changes: Any,
) -> AreaResult:
    """A body of given sections on a floor at elevation 330."""
    step = height / slices
    middles = (np.arange(slices) + 0.5) * step
    outlines = [rings_at(float(z)) for z in middles]
    areas = [area_at(rings) for rings in outlines]
    volume = sum(areas) * step
    pieces = [
        Slice(ORIGIN[2] + float(z), step, a, a * step, points // slices)
        for z, a in zip(middles, areas)
    ]
    body_fields: Dict[str, Any] = dict(  # noqa: C408
        origin=ORIGIN,
        points=scattered(rings_at, height, points),
        outliers=np.random.default_rng(5).uniform(-2, 2, (200, 3)).astype(np.float32),
        ground=ground_points(),
        outlines=outlines,
        gaps=gaps,
        convergence=[(n, boxes(rings_at, area_at, height, n)) for n in doubled(slices)],
        floor=Floor((0.02, 0.0, 0.9998), 330.0, 1.146, 4321, "in the cloud"),
    )
    known: Dict[str, Any] = dict(  # noqa: C408
        volume_m3=volume,
        std_m3=0.01 * volume,
        budget=(
            BudgetItem("survey", 0.003 * volume),
            BudgetItem("outline", 0.008 * volume),
            BudgetItem("sampling", 0.005 * volume),
            BudgetItem("slicing", 0.001 * volume),
        ),
        surface_area_m2=12.6,
        min_z_m=ORIGIN[2],
        max_z_m=ORIGIN[2] + height,
        max_height_m=height,
        points_used=points,
        points_left_out={"ground": 4321, "outliers": 200},
        slice_height_m=step,
        slices=pieces,
        checks=(Check("tetrahedra", 1.002 * volume),),
        body=Body(**{**body_fields, **(changes_of_body or {})}),
    )
    return surveys.body(name, **{**known, **changes})


def doubled(last: int) -> List[int]:
    counts = [4]
    while counts[-1] * 2 < last:
        counts.append(counts[-1] * 2)
    return [*counts, last]


def boxes(rings_at: Any, area_at: Any, height: float, count: int) -> float:
    step = height / count
    return sum(area_at(rings_at((k + 0.5) * step)) * step for k in range(count))


def scattered(rings_at: Callable[[float], Rings], height: float, count: int) -> Any:
    """Points on the rings, with a little noise."""
    random = np.random.default_rng(4)
    levels = np.clip(random.uniform(0, height, 600), 1e-3 * height, 0.999 * height)
    made = []
    for z in levels:
        ring = np.vstack(rings_at(float(z)))
        some = ring[random.integers(0, len(ring), count // len(levels))]
        shake = random.normal(0, 0.006, some.shape)
        made.append(np.column_stack([some + shake, np.full(len(some), z)]))
    return np.vstack(made).astype(np.float32)


def ground_points() -> Any:
    xy = np.random.default_rng(6).uniform(-2.4, 2.4, (3000, 2))
    xy = xy[np.hypot(*xy.T) > 1]
    return np.column_stack([xy, np.zeros(len(xy))]).astype(np.float32)


def ball(name: str = "Ball", **changes: Any) -> AreaResult:
    gaps = (Gap(0.0, 0.0, 2.0, 0.31), Gap(0.95, 0.2, 0.8, 0.12))
    return body(name, ball_rings, 2.0, **{"gaps": gaps, **changes})


def torus(name: str = "Torus", **changes: Any) -> AreaResult:
    return body(name, torus_rings, 1.0, **changes)


def measurement(*results: Any, **changes: Any) -> Measurement:
    known: Dict[str, Any] = {"shape": "object", "method": "section", "warnings": ()}
    return surveys.measurement(*results, **{**known, **changes})


def extent(result: AreaResult) -> Tuple[FloatArray, FloatArray]:
    """Lowest and highest coordinates of the points of a body."""
    assert result.body is not None
    return result.body.points.min(axis=0), result.body.points.max(axis=0)


def body_of(result: AreaResult) -> Body:
    assert result.body is not None
    return result.body


def with_body(result: AreaResult, **changes: Any) -> AreaResult:
    return dataclasses.replace(result, body=dataclasses.replace(body_of(result), **changes))


def plain(text: str) -> str:
    return text.replace(THIN_SPACE, " ").replace("\u00a0", " ")
