"""What the user should know of a body's measurement: one line each."""

from __future__ import annotations

from typing import Callable, Iterator, Sequence

from ...types import Gap
from .enclose import Enclosed
from .standing import Standing
from .voxels import Thinned

__all__ = ["open_surface", "words"]

#: Shares of the volume, or of the points, that are worth a word.
_HIDDEN = 0.02
_STRAYS = 0.03
_THIN = 0.03
_LOST = 0.25

_GAP_ADVICE = "; --max-gap sets how wide an opening may be closed"
_FLOOR_ADVICE = "; --floor none measures all points"

_Place = Callable[[Gap], str]


def words(
    cloud: Thinned,
    standing: Standing,
    body: Enclosed,
    hidden: float,
    volume: float,
    place: _Place,
    *,
    floor_asked: bool,
    gap_asked: bool,
) -> tuple[str, ...]:
    """Return what to warn of, the gravest first.

    Parameters
    ----------
    floor_asked, gap_asked : the user said what the floor is, and how wide a gap may be closed:
        nothing advises that then.
    """
    return (
        *_leaks(body, place),
        *_gaps(body, place, "" if gap_asked else _GAP_ADVICE),
        *_floor(standing, hidden, volume, "" if floor_asked else _FLOOR_ADVICE),
        *_walls(body),
        *_hollows(body, volume),
        *_points(cloud, standing),
    )


def open_surface(leaks: Sequence[Gap], place: _Place) -> str:
    """Return why points enclose nothing, and what to do."""
    if leaks:
        widest = leaks[0]
        return (
            f"the surface is open at {place(widest)}, {widest.width:.3g} m wide, wider than "
            f"--max-gap allows; give --max-gap {1.01 * widest.width:.3g} to close it, or "
            "photograph that side"
        )
    return (
        "the points enclose no space: expected the surface of a body seen from all sides; for a "
        "body on the ground keep some ground round it or give --floor Z, for a piece of land use "
        "--shape terrain"
    )


def _leaks(body: Enclosed, place: _Place) -> Iterator[str]:
    for leak in body.leaks[:3]:
        yield (
            f"the surface is open at {place(leak)}, {leak.width:.3g} m wide: what lies behind is "
            f"not counted; give --max-gap {1.01 * leak.width:.3g} to close it"
        )


def _gaps(body: Enclosed, place: _Place, advice: str) -> Iterator[str]:
    if body.gaps:
        widest, number = body.gaps[0], len(body.gaps)
        count = "1 opening in the surface was" if number == 1 else f"{number} openings were"
        yield (f"{count} closed, the widest {widest.width:.3g} m wide at {place(widest)}{advice}")


def _floor(standing: Standing, hidden: float, volume: float, advice: str) -> Iterator[str]:
    floor = standing.floor
    if floor is None:
        return
    if floor.found == "lowest points":
        yield (
            "the body is open below and no ground is in the cloud: it was closed flat at its "
            "lowest points; --floor Z sets another elevation"
        )
    elif floor.found == "in the cloud":
        yield (
            f"{floor.points:,} points lie on a floor at {floor.elevation:.3f} m, tilted by "
            f"{floor.tilt_degrees:.1f} degrees: they were left out and the body stands upright on "
            f"it{advice}"
        )
    if hidden > _HIDDEN * volume:
        yield (
            f"the lowest {standing.unsure:.3g} m above the floor were not seen: half of what is "
            f"upright below the lowest section, {hidden:.4g} m3, was added; photograph from lower "
            "down"
        )


def _walls(body: Enclosed) -> Iterator[str]:
    if body.thin_walled:
        yield (
            f"the walls are thinner than 3 point spacings ({body.spacing:.2g} m): their two sides "
            "cannot be told apart and the volume may be off by several percent; take more points"
        )
        return
    # Noise makes the skin thick on both sides, thin walls on the inner side only.
    thin = max(0.0, body.inner - body.outer) / body.within
    if thin > _THIN or body.narrow > _LOST:
        yield (
            f"{100 * max(thin, body.narrow):.0f} % of the body are thinner than 3 point spacings "
            f"({body.spacing:.2g} m) or lost in noise; take more points"
        )


def _hollows(body: Enclosed, volume: float) -> Iterator[str]:
    if body.water > 0.002 * volume and not body.hollow:
        yield (
            f"a hollow that would hold {body.water:.4g} m3 of water counts as solid; --hollow "
            "leaves it out"
        )
    if body.voids > 0.002 * volume and not body.hollow:
        yield (
            f"{body.voids:.4g} m3 are enclosed voids; they count as solid unless --hollow is given"
        )


def _points(cloud: Thinned, standing: Standing) -> Iterator[str]:
    total = int(cloud.counts.sum())
    if cloud.edge > 0.0:
        yield (
            f"{total:,} points were thinned to {len(cloud.points):,}, one for each cube of "
            f"{cloud.edge:.2g} m"
        )
    if standing.stray_count > _STRAYS * total:
        share = 100.0 * standing.stray_count / total
        yield f"{share:.0f} % of the points are strays far from the surface and were left out"
