"""Changes, series and stage curves made from formulas, in the style of surveys.py."""

from __future__ import annotations

import dataclasses
from typing import Any, Sequence

import numpy as np
import shapely

from quantify_client.types import (
    Aligned,
    AreaFailure,
    AreaResult,
    Epochs,
    Measurement,
    Notice,
    PourPoint,
    StableGround,
    Stage,
    StageLevel,
)

from . import surveys


def gain_and_loss(x: Any, y: Any) -> Any:
    """A heap that came beside a pit that went."""
    up = np.clip(2.5 * (1 - np.hypot(x - 13, y - 18) / 9), 0, None)
    return up - np.clip(1.8 * (1 - np.hypot(x - 29, y - 18) / 8), 0, None)


def changed(name: str = "Quarry floor", **changes: Any) -> AreaResult:
    area = shapely.box(2, 5, 40, 31)
    ground = surveys.relief(gain_and_loss, area)
    small = np.isfinite(ground.above_base_m) & (np.abs(ground.above_base_m) < 0.06)
    ground = dataclasses.replace(ground, undetected=small, sigma_m=np.full(small.shape, 0.03))
    known = {
        "base": "june.laz",
        "level_of_detection_m": 0.0588,
        "area_changed_m2": 247.0,
        "checks": (),
        "budget": (*surveys.pile().budget, surveys.BudgetItem("alignment", 1.2, 0.6, 0.6)),
    }
    return surveys.terrain(name, ground, **{**known, **changes})


def aligned(**changes: Any) -> Aligned:
    known = Aligned(
        moved="site/july.laz",
        reference="site/june.laz",
        aligned=True,
        shift_m=(0.4021, -0.2968, 0.1013),
        shift_std_m=(0.0042, 0.0039, 0.0018),
        tilt=(3.1e-4, -1.9e-4),
        stable_rms_m=0.0312,
        before_rms_m=0.2214,
        bias_m=-0.1043,
        bias_std_m=0.0061,
        stable_area_m2=12_340.0,
    )
    return dataclasses.replace(known, **changes)


def stable_ground(count: int = 20_000) -> StableGround:
    random = np.random.default_rng(5)
    before, after = random.normal(0.1, 0.2, count), random.normal(0.0, 0.031, count)
    before[:50], after[:50] = 9.0, -9.0  # something that did change
    return StableGround(before, after)


def change(*results: Any, **changes: Any) -> Measurement:
    known = {
        "source": "site/july.laz",
        "kind": "change",
        "alignment": aligned(),
        "warnings": (Notice("survey-moved", "july.laz was moved by +0.402 m east"),),
    }
    return surveys.measurement(*(results or (changed(),)), **{**known, **changes})


def between(before: str, after: str, volumes: Sequence[float], **changes: Any) -> Epochs:
    """Changes of areas "Area 1", "Area 2", ...: half as much again is gained as is told."""
    results = tuple(
        surveys.body(
            f"Area {number + 1}",
            volume_m3=net,
            cut_m3=max(net, 0.0) + 10.0,
            fill_m3=max(-net, 0.0) + 10.0,
            std_m3=6.5,
            cut_std_m3=5.0,
            fill_std_m3=4.0,
            slices=(),
        )
        for number, net in enumerate(volumes)
    )
    return dataclasses.replace(Epochs(before, after, results, (), aligned()), **changes)


def series(surveys_of: int = 4, areas: int = 2) -> Sequence[Epochs]:
    """Each pair and the whole; the second area of the second pair could not be measured."""
    names = [f"flights/2026-{month + 1:02d}-14 quarry.laz" for month in range(surveys_of)]
    volumes = [
        [120.0 * (area + 1) * np.cos(1.3 * k + area) for area in range(areas)]
        for k in range(surveys_of - 1)
    ]
    pairs = [between(*pair, made) for *pair, made in zip(names, names[1:], volumes)]
    if surveys_of > 2:
        if areas > 1:
            one = pairs[1]
            failed = AreaFailure("Area 2", "points support 12 % of it; fly it again")
            kept = tuple(r for r in one.results if r.name != "Area 2")
            pairs[1] = dataclasses.replace(one, results=kept, failures=(failed,))
        total = [float(sum(column)) + 4.0 for column in zip(*volumes)]
        pairs.append(between(names[0], names[-1], total))
    return tuple(pairs)


def stage() -> Stage:
    """A bowl z = 328 + r^2 / 60: below h over its lowest place it holds 30 pi h^2."""
    depths = np.linspace(0.25, 3.5, 14)
    levels = [
        StageLevel(
            328.0 + float(h),
            float(60 * np.pi * h),
            float(30 * np.pi * h**2),
            float(2.0 + 3.0 * h),
            bool(h > 2.4),
        )
        for h in depths
    ]
    east, north = surveys.EASTING + 60, surveys.NORTHING + 25
    points = (
        PourPoint(330.4, east + 26.0, north + 16.0, 542.9, 452.4, 328.0, outside=True),
        PourPoint(329.1, east + 6.0, north + 9.0, 18.25, 37.0, 328.6, outside=True),
        PourPoint(329.0, east + 15.0, north + 17.0, 9.5, 21.0, 328.5, outside=False),
    )
    return Stage(levels, points)


def pond(name: str = "Settling pond", **changes: Any) -> AreaResult:
    return dataclasses.replace(surveys.hollow(name), bases=(), stage=stage(), **changes)
