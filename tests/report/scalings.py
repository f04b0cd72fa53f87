"""Scalings made by hand: what the table, the page and the picture of a scaling are tested with."""

from __future__ import annotations

import math
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from quantify_client.types import ControlledPoint, DirectHeight, ScaleObservation, Scaling

HOSTILE = "<script>alert(1)</script>[red]\x1b[31m\u202e"
LETTERS = "ABCDEFGHJKLMNOPQRSTUVWXYZ"
IDENTITY = tuple(tuple(float(v) for v in row) for row in np.eye(4))

Places = Dict[str, Tuple[float, float, float]]


def observation(
    kind: str,
    names: Sequence[str],
    residual: float,
    sigma: float,
    *,
    component: Optional[str] = None,
    observed: float = 0.0,
    redundancy: Optional[float] = 0.7,
    contribution: Optional[float] = 0.02,
    **changes: Any,
) -> ScaleObservation:
    adjusted = observed + residual
    return ScaleObservation(
        kind,
        component,
        tuple(names),
        observed,
        adjusted,
        residual,
        sigma,
        redundancy,
        contribution,
        **changes,
    )


def scaling(**changes: Any) -> Scaling:
    known: Dict[str, Any] = dict(  # noqa: C408
        factor=1.204817,
        std=0.000312,
        transform=IDENTITY,
        mode="scale",
        target_crs=None,
        observations=(),
        points=(),
        direct=(),
        rms_m=None,
        check_rms_m=None,
        carried_by="the scale comes from 1 scale bar (known to 0.05 %; nothing else fixes it)",
        conflict="",
        tilt_std_deg=None,
        warnings=(),
    )
    return Scaling(**{**known, **changes})


def least() -> Scaling:
    """One scale bar between two points of the cloud: nothing controls it."""
    bar = observation("scale_bar", "PQ", 0.0, 0.001, observed=2.0, redundancy=0.0, contribution=1.0)
    return scaling(observations=(bar,))


def positions(at: Places, gps: float, random: np.random.Generator) -> List[ScaleObservation]:
    return [
        observation(
            "gps", (name,), random.normal(0, gps), gps, component=component, contribution=0.001
        )
        for name in at
        for component in ("east", "north")
    ]


def picks(at: Places, sigma: float, random: np.random.Generator) -> List[ScaleObservation]:
    return [
        observation(
            "cloud", (name,), random.normal(0, sigma), sigma, component=component, redundancy=0.4
        )
        for name in at
        for component in "xyz"
    ]


def tape(at: Places, names: str, random: np.random.Generator, **changes: Any) -> ScaleObservation:
    length = math.dist(at[names[0]], at[names[-1]])
    known = {"observed": length, "contribution": length**2 / 40_000}
    known.update(changes)
    return observation(
        "distance", names, known.pop("residual", random.normal(0, 0.005)), 0.005, **known
    )


def controlled(
    at: Places, observations: Sequence[ScaleObservation], *, tied: bool = True
) -> List[ControlledPoint]:
    """Points whose residuals are those of the observations."""
    found = {(o.kind, o.names, o.component): o.residual for o in observations}
    points = []
    for name, (east, north, up) in at.items():
        gps = [found.get(("gps", (name,), c)) for c in ("east", "north")]
        cloud = [found.get(("cloud", (name,), c)) for c in "xyz"]
        points.append(
            ControlledPoint(
                name,
                east,
                north,
                up,
                (0.011, 0.012, 0.021),
                None if None in gps else tuple(gps),
                None if None in cloud else tuple(cloud),
                lon=-91.99 + east / 76_000 if tied else None,
                lat=46.84 + north / 111_200 if tied else None,
                elevation_m=330.0 + up if tied else None,
            )
        )
    return points


def everything(gps: float = 0.03, name: str = "A") -> Scaling:
    """Nine points, tapes, one of them wrong and one a check, heights and a conflict."""
    random = np.random.default_rng(5)
    at: Places = {
        letter: (float(e), float(n), float(u))
        for letter, e, n, u in [
            ("A", -38.0, -21.0, 0.4), ("B", -14.5, -27.0, 1.9), ("C", 12.0, -24.0, 4.1),
            ("D", 36.0, -12.0, 6.0), ("E", 31.0, 17.0, 3.3), ("F", 6.0, 25.0, 1.2),
            ("G", -22.0, 22.0, -0.8), ("H", -35.0, 4.0, -1.0), ("P", -2.0, 1.0, 2.0),
        ]
    }  # fmt: skip
    observed: List[ScaleObservation] = positions({k: at[k] for k in "ABCDEFG"}, gps, random)
    observed += picks(at, 0.012, random)
    observed += [tape(at, names, random) for names in "AB BC CD DE EF FG GH HA BP PF PD".split()]
    observed += [
        tape(at, "AC", random, residual=0.31, outlier=True, redundancy=None, contribution=None),
        tape(at, "GP", random, residual=-0.012, check=True, redundancy=None, contribution=None),
        observation("scale_bar", "PE", 0.0008, 0.001, observed=36.7, contribution=0.31),
        observation("elevation", "B", 0.011, 0.02, observed=331.9, contribution=0.0),
        observation("elevation", "D", -0.052, 0.02, observed=336.0, contribution=0.0),
        observation("elevation", "H", 0.0, 0.02, observed=329.0, redundancy=0.0, contribution=0.0),
    ]
    renamed = [
        ScaleObservation(**{**vars(o), "names": tuple(name if n == "A" else n for n in o.names)})
        for o in observed
    ]
    points = controlled({name if k == "A" else k: v for k, v in at.items()}, renamed)
    return scaling(
        mode="full",
        target_crs="EPSG:32615",
        observations=renamed,
        points=points,
        direct=[
            DirectHeight(name, "B", 24.30, 24.25, 1.56, 0.21),
            DirectHeight("B", "C", 26.8, 26.79, 0.73, 0.9, (0.0, 2.1), f"B-C: too level {name}"),
            DirectHeight("C", "D", 26.9, 27.0, None, None, None, "C-D: the tape is shorter"),
        ],
        rms_m=0.0048,
        check_rms_m=0.012,
        carried_by="the scale comes from 11 tapes (known to 0.026 %; without them it would be "
        "known to 0.05 %); 1 scale bar help; 7 positions and 3 elevations add next to nothing",
        conflict=f"tape {name}-C disagrees with the rest by 0.310 m, 62.0 sigma",
        tilt_std_deg=0.031,
        warnings=("The sigmas of 'gps' were raised by 1.4.", f"odd {name}"),
    )


def crowd(count: int = 100, spread: Tuple[float, float] = (180.0, 120.0)) -> Scaling:
    """Many points, each with a tape to the next."""
    random = np.random.default_rng(7)
    east, north = (random.uniform(-side / 2, side / 2, count) for side in spread)
    at: Places = {
        f"{LETTERS[i % 25]}{i // 25 + 1}": (float(e), float(n), 0.0)
        for i, (e, n) in enumerate(zip(east, north))
    }
    names = list(at)
    observed = [*positions(at, 1.5, random), *picks(at, 0.02, random)]
    for i in (0, 1):  # one position is 13 m off, and was left out
        observed[i] = observation(
            "gps", (names[0],), 9.0, 1.5, component=observed[i].component, redundancy=None,
            contribution=None, outlier=True,
        )  # fmt: skip
    for pair in zip(names, names[1:]):
        length = math.dist(at[pair[0]], at[pair[1]])
        residual = float(random.normal(0, 0.006))
        observed.append(observation("distance", pair, residual, 0.005, observed=length))
    return scaling(
        mode="full", target_crs="EPSG:32615", observations=observed,
        points=controlled(at, observed), carried_by="the scale comes from 99 tapes",
        conflict="", rms_m=0.006,
    )  # fmt: skip


def in_a_line(count: int = 6, direction: Tuple[float, float] = (1.0, 0.0)) -> Scaling:
    """Points in one line, taped one to the next."""
    random = np.random.default_rng(3)
    at: Places = {
        LETTERS[i]: (20.0 * i * direction[0], 20.0 * i * direction[1], 0.0) for i in range(count)
    }
    observed = positions(at, 0.5, random)
    observed += [tape(at, a + b, random) for a, b in zip(list(at), list(at)[1:])]
    return scaling(
        mode="shift", target_crs="EPSG:32615", observations=observed,
        points=controlled(at, observed),
    )  # fmt: skip


def unplaced() -> Scaling:
    """Points of the cloud and scale bars between them; nothing ties them to the Earth."""
    random = np.random.default_rng(2)
    at: Places = {"P": (0.0, 0.0, 0.0), "Q": (2.0, 0.1, 0.0), "R": (1.1, 1.6, 0.2)}
    observed = picks(at, 0.002, random)
    observed += [
        observation("scale_bar", pair, 0.0006, 0.001, observed=2.0, contribution=0.4)
        for pair in ("PQ", "QR")
    ]
    return scaling(observations=observed, points=controlled(at, observed, tied=False))
