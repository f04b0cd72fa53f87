"""The warnings of a body's measurement."""

from __future__ import annotations

from typing import Callable, Iterator, Sequence

from ...types import Gap, Notice
from ..body_slices import BodyRecipe
from .enclose import Enclosed, Unseen
from .floor import Standing
from .voxels import Thinned

__all__ = ["body_warnings", "why_open"]

#: Shares of the volume, or of the points, from which on a warning is given.
_HIDDEN = 0.02
_OUTLIERS = 0.03
_THIN = 0.03
_LOST = 0.25
_HOLLOW = 0.002

_GAP_ADVICE = "; --max-gap sets how wide an opening may be closed"
_FLOOR_ADVICE = "; --floor none measures all points"

#: Share of the points outside of the body above which that is told.
_APART = 0.005

_Place = Callable[[Gap], str]


def body_warnings(
    cloud: Thinned,
    standing: Standing,
    body: Enclosed,
    hidden: float,
    volume: float,
    place: _Place,
    recipe: BodyRecipe,
) -> Iterator[Notice]:
    """Yield what to warn of, the gravest first.

    Parameters
    ----------
    hidden, volume : below the lowest section, and of the whole body, cubic metres.
    place : says where an opening is.
    recipe : what the user said already is not advised.
    """
    given = 0 if recipe.cameras is None else len(recipe.cameras)
    yield from _openings(body, place, given, "" if recipe.max_gap is not None else _GAP_ADVICE)
    yield from _floor(standing, hidden, volume, "" if recipe.floor != "auto" else _FLOOR_ADVICE)
    yield from _apart(standing, body)
    yield from _walls(body)
    if not recipe.hollow:
        yield from _hollows(body, volume)
    yield from _points(cloud, standing)


def why_open(leaks: Sequence[Gap], place: _Place, recipe: BodyRecipe) -> str:
    """Return why points enclose nothing, and what to do."""
    if leaks:
        widest = leaks[0]
        return (
            f"the surface is open at {place(widest)}, {widest.width:.3g} m wide, wider than "
            f"--max-gap allows; give --max-gap {1.01 * widest.width:.3g} to close it, or "
            "photograph that side"
        )
    if recipe.max_gap is not None or recipe.hollow:
        name = "--hollow" if recipe.max_gap is None else f"--max-gap {recipe.max_gap:g}"
        return (
            f"the points enclose no space with {name}: without it what was not seen is completed; "
            "leave it out, or take photographs of all sides"
        )
    return (
        "the points enclose no space: expected the surface of a body seen from all sides; for a "
        "body on the ground keep some ground round it or give --floor Z, for a piece of land use "
        "--shape terrain"
    )


def _apart(standing: Standing, body: Enclosed) -> Iterator[Notice]:
    """Yield that points lie outside of the body that was found, which should be on it."""
    # The others are those of the lid, which is wider than the body.
    numbers = body.apart[body.apart < len(standing.points)]
    count, total = int(standing.counts[numbers].sum()), int(standing.counts.sum())
    if count > _APART * total:
        belong = "what they belong to is not in the volume"
        if body.walls > 0.0:
            belong = (
                f"most of the thin walls that they may be ({body.walls:.3g} m3) was added, and "
                "nothing else that they belong to"
            )
        yield Notice(
            "points-outside-body",
            f"{count / total:.1%} of the points ({count:,}) lie outside of the body that was "
            f"found: they enclose nothing by themselves, and {belong}; look at the pictures, give "
            "--floor, or take more photographs there",
            points=count,
            share=count / total,
        )


def _openings(body: Enclosed, place: _Place, cameras: int, advice: str) -> Iterator[Notice]:
    for leak in body.leaks[:3]:
        yield Notice(
            "surface-open",
            f"the surface is open at {place(leak)}, {leak.width:.3g} m wide: what lies behind is "
            f"not counted; give --max-gap {1.01 * leak.width:.3g} to close it",
            width_m=leak.width,
        )
    if body.unseen is not None:
        yield _completed(body.unseen, body.gaps, place, cameras)
        yield from _left_out(body.unseen, cameras)
    elif body.gaps:
        widest, number = body.gaps[0], len(body.gaps)
        count = "1 opening in the surface was" if number == 1 else f"{number} openings were"
        yield Notice(
            "openings-closed",
            f"{count} closed, the widest {widest.width:.3g} m wide at {place(widest)}{advice}",
            count=number,
            width_m=widest.width,
        )


def _completed(unseen: Unseen, gaps: Sequence[Gap], place: _Place, cameras: int) -> Notice:
    """Return that a part of the surface was not seen, and between what the volume may lie."""
    where = f" (the widest opening at {place(gaps[0])})" if gaps else ""
    if unseen.cameras:
        number = unseen.cameras
        told = f"{number:,} known camera position{'s tell' if number > 1 else ' tells'}"
    else:
        told = "cameras are taken to have stood all round it, which tells"
    advice = "photographs of these sides, or from lower down, make the error smaller"
    if not cameras:
        advice += "; so may --cameras FILE, with where the cameras stood"
    return Notice(
        "surface-completed",
        f"{unseen.share:.0%} of the surface was not seen{where}: completed in two ways it encloses "
        f"{unseen.low:.4g} and {unseen.high:.4g} m3; the volume lies between, but for what "
        f"triangles between points cut off, and what they differ by is a part of its error ({told} "
        f"what is empty); {advice}",
        share=unseen.share,
        low_m3=unseen.low,
        high_m3=unseen.high,
        cameras=unseen.cameras,
    )


def _left_out(unseen: Unseen, cameras: int) -> Iterator[Notice]:
    """Yield that cameras cannot have stood where they are said to."""
    count = cameras - unseen.cameras
    if count > 0:
        yield Notice(
            "cameras-left-out",
            f"{count:,} of {cameras:,} camera positions were left out: below the floor, or, as "
            "most are, within the body; give them in the cloud's own coordinates and unit",
            count=count,
        )


def _floor(standing: Standing, hidden: float, volume: float, advice: str) -> Iterator[Notice]:
    floor = standing.floor
    if floor is None:
        return
    if floor.found == "lowest points":
        yield Notice(
            "floor-at-lowest-points",
            "the body is open below and the cloud holds no ground: it was taken to stand level on "
            "its lowest points, and what lies lower is not measured; --floor Z sets another "
            "elevation",
            elevation_m=floor.elevation,
        )
    elif floor.found == "in the cloud":
        yield Notice(
            "floor-found",
            f"{floor.points:,} points lie on a floor at {round(floor.elevation, 3) + 0.0:.3f} m, "
            f"tilted by {floor.tilt_degrees:.1f} degrees: they were left out and the body stands "
            f"upright on it{advice}",
            points=floor.points,
            elevation_m=floor.elevation,
            tilt_degrees=floor.tilt_degrees,
        )
    if hidden > _HIDDEN * volume:
        gap = standing.sure + standing.unsure
        yield Notice(
            "foot-not-seen",
            f"the lowest {gap:.3g} m were left out with the floor or not seen: {hidden:.4g} m3 was "
            "added, what would stand upright there, and half of it for the "
            f"{standing.unsure:.3g} m that were not seen; photograph from lower down",
            height_m=standing.unsure,
            volume_m3=hidden,
        )


def _walls(body: Enclosed) -> Iterator[Notice]:
    # Noise makes the skin thick on both sides, thin walls on the inner side only.
    thin = max(0.0, body.inner - body.outer) / body.within
    share = max(thin, body.narrow)
    if body.thin_walled:
        yield Notice(
            "walls-too-thin",
            f"the walls are thinner than 3 point spacings ({body.spacing:.2g} m): their two sides "
            "cannot be told apart and the volume may be off by several percent; take more points",
            spacing_m=body.spacing,
        )
    elif thin > _THIN or body.narrow > _LOST:
        yield Notice(
            "parts-too-thin",
            f"{100 * share:.0f} % of the body are thinner than 3 point spacings "
            f"({body.spacing:.2g} m) or lost in noise; take more points",
            share=share,
            spacing_m=body.spacing,
        )


def _hollows(body: Enclosed, volume: float) -> Iterator[Notice]:
    if body.water > _HOLLOW * volume:
        yield Notice(
            "hollow-counts-as-solid",
            f"a hollow that would hold {body.water:.4g} m3 of water counts as solid; --hollow "
            "leaves it out",
            volume_m3=body.water,
        )
    if body.voids > _HOLLOW * volume:
        yield Notice(
            "voids-count-as-solid",
            f"{body.voids:.4g} m3 are enclosed voids; they count as solid unless --hollow is given",
            volume_m3=body.voids,
        )


def _points(cloud: Thinned, standing: Standing) -> Iterator[Notice]:
    total = int(cloud.counts.sum())
    if cloud.edge > 0.0:
        yield Notice(
            "points-thinned",
            f"{total:,} points were thinned to {len(cloud.points):,}, one for each cube of "
            f"{cloud.edge:.2g} m",
            points=total,
            kept=len(cloud.points),
            edge_m=cloud.edge,
        )
    share = standing.outlier_count / total
    if share > _OUTLIERS:
        yield Notice(
            "outliers-left-out",
            f"{100.0 * share:.0f} % of the points are outliers far from the surface and were left "
            "out",
            share=share,
        )
