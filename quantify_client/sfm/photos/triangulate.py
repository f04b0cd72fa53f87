"""Picks of control points in photographs -> their positions in the delivered cloud.

The position is where the lines of sight meet with the least squares of pixels; its covariance is
(J^T J)^-1 sigma^2. The cameras' own errors are not in it: they show in how badly the lines of
sight meet, so sigma is what the residuals of all points together show where that is more than what
was promised, and a point whose residuals are more than chance is given its own. It is never less
than what was promised.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Dict, Iterator, List, Mapping, Sequence, Tuple

import numpy as np

from ...errors import ControlError, UsageError
from ...scaler.control.model import Pick
from ...types import FloatArray, Notice
from ..odm.json_files import shown
from .cameras import Shots
from .outliers import Choice, choose, is_misfit, pooled, typical
from .rays import Intersection, NoIntersectionError, Rays, intersect, trace

__all__ = ["SeenPick", "Sighting", "triangulate"]

_NARROW = 1.0  # degrees: below, a position is ten and more times less certain in depth than across
_FAR_OFF = 5.0  # sigmas: picks that miss by more are worth a word even where all do


@dataclass(frozen=True)
class SeenPick:
    """A pick, and how far from it the point is seen.

    Attributes
    ----------
    image : as the project names it.
    px, py : as picked.
    residual_px : length of ``offset``; NaN where the point cannot be seen in the photograph.
    offset : (dx, dy) = picked - projected, pixels right and down.
    outlier : left out, because all others meet much better without it.
    """

    image: str
    px: float
    py: float
    residual_px: float
    offset: Tuple[float, float]
    outlier: bool = False


@dataclass(frozen=True)
class Sighting:
    """Where a point is, by its picks.

    Attributes
    ----------
    name : the point's.
    xyz : in the coordinates of the delivered cloud.
    covariance : (3, 3) float64 of x, y and z, with ``sigma_px``.
    rms_px : root mean square of ``residual_px`` of the picks used.
    sigma_px : one sigma of a pick in x and in y: what was promised, or what the misses show.
    picks : in the given order, without those whose photograph the project does not have.
    warnings : what was left out or does not fit, one line each.
    """

    name: str
    xyz: Tuple[float, float, float]
    covariance: FloatArray
    rms_px: float
    sigma_px: float
    picks: Sequence[SeenPick]
    warnings: Sequence[Notice] = ()


def triangulate(
    shots: Shots, picks: Sequence[Pick], pixel_sigma: float = 1.0
) -> Mapping[str, Sighting]:
    """Return where picked points are, in the coordinates of the delivered cloud.

    Parameters
    ----------
    shots : Shots
        From :func:`quantify_client.sfm.photos.cameras.read_shots`.
    picks : sequence of Pick
        Pixels from the left and top of the photographs as ODM got them.
    pixel_sigma : float
        One sigma of a pick, in x and in y. All points together widen it where they miss by more.

    Returns
    -------
    mapping of str to Sighting
        By the points' names, in the order of their first picks.

    Raises
    ------
    ControlError
        A point is picked in fewer than two photographs of the project, twice in one or outside of
        one, or its rays are parallel or meet behind a camera.
    UsageError
        `pixel_sigma` is not a finite number above 0.
    """
    if not (math.isfinite(pixel_sigma) and pixel_sigma > 0):
        raise UsageError(
            f"pixel_sigma is {pixel_sigma}; expected the standard deviation of a pick in pixels, "
            "above 0"
        )
    by_point: Dict[str, List[Pick]] = {}
    for pick in picks:
        by_point.setdefault(pick.name, []).append(pick)
    rays = {name: trace(shots, name, group) for name, group in by_point.items()}
    whole = {name: _intersect_all(item) for name, item in rays.items()}
    spread = typical([choice.fit for choice in whole.values()], pixel_sigma)
    chosen = {name: choose(item, whole[name], pixel_sigma, spread) for name, item in rays.items()}
    fits = {name: _required(rays[name], choice) for name, choice in chosen.items()}
    spread = pooled(fits, pixel_sigma)
    return {
        name: _sighting(item, chosen[name], fits[name], pixel_sigma, spread)
        for name, item in rays.items()
    }


def _intersect_all(rays: Rays) -> Choice:
    try:
        return Choice(intersect(rays, np.ones(len(rays), dtype=bool)))
    except NoIntersectionError as error:
        return Choice(None, str(error))


def _required(rays: Rays, choice: Choice) -> Intersection:
    if choice.fit is not None:
        return choice.fit
    which = ", ".join(rays.image(index) for index in range(min(len(rays), 3)))
    raise ControlError(
        f"point {shown(rays.name)} has no position: {choice.problem} ({len(rays)} picks: {which}); "
        "expected picks of one thing seen from places well apart: check them, or pick it in others"
    )


def _sighting(
    rays: Rays, choice: Choice, fit: Intersection, promised: float, spread: float
) -> Sighting:
    misfit = is_misfit(fit, promised, spread)
    own = fit.cost / promised**2 / fit.degrees_of_freedom
    sigma = promised * math.sqrt(max(spread, own) if misfit else spread)
    covariance = np.asarray(np.linalg.inv(fit.normal) * sigma**2, dtype=np.float64)
    lengths = np.hypot(fit.misses[:, 0], fit.misses[:, 1])
    x, y, z = (float(value) for value in fit.xyz + rays.origin)
    rms = math.sqrt(fit.cost / int(fit.used.sum()))
    return Sighting(
        name=rays.name,
        xyz=(x, y, z),
        covariance=(covariance + covariance.T) / 2,  # rounding is not symmetric
        rms_px=rms,
        sigma_px=sigma,
        picks=tuple(
            SeenPick(
                image=shot.image,
                px=float(rays.pixels[index, 0]),
                py=float(rays.pixels[index, 1]),
                residual_px=float(lengths[index]),
                offset=(float(fit.misses[index, 0]), float(fit.misses[index, 1])),
                outlier=not fit.used[index],
            )
            for index, shot in enumerate(rays.shots)
        ),
        warnings=(
            *rays.warnings,
            *_left_out(rays, fit, lengths),
            *_disagreement(rays, choice, rms, promised, misfit or own > _FAR_OFF**2),
            *_narrowness(rays, fit, covariance),
        ),
    )


def _left_out(rays: Rays, fit: Intersection, lengths: FloatArray) -> Iterator[Notice]:
    for index in np.flatnonzero(~fit.used).tolist():
        where = "does not look to where the others meet"
        if np.isfinite(lengths[index]):
            where = f"is {lengths[index]:.1f} px from where the others meet"
        yield Notice(
            "pick-left-out",
            f"point {shown(rays.name)}: its pick in {rays.image(index)} {where} and is left out; "
            "check it",
            point=rays.name,
            image=rays.shots[index].image,
            residual_px=float(lengths[index]),
        )


def _disagreement(
    rays: Rays, choice: Choice, rms: float, promised: float, is_notable: bool
) -> Iterator[Notice]:
    point = f"point {shown(rays.name)}"
    if choice.doubt is not None:
        one, other = (rays.image(index) for index in choice.doubt)
        yield Notice(
            "pick-undecided",
            f"{point}: its picks disagree by {rms:.1f} px (RMS), and either the one in {one} or "
            f"the one in {other} is wrong; none is left out: check both, or pick it in another "
            "photograph",
            point=rays.name,
            images=[one, other],
            rms_px=rms,
        )
    elif is_notable:
        images = [rays.image(index) for index in range(min(len(rays), 4))]
        yield Notice(
            "picks-disagree",
            f"{point}: its picks ({', '.join(images)}) disagree by {rms:.1f} px (RMS) where "
            f"{promised:g} px per axis are expected, so its standard deviation is enlarged: check "
            "them",
            point=rays.name,
            images=images,
            rms_px=rms,
        )


def _narrowness(rays: Rays, fit: Intersection, covariance: FloatArray) -> Iterator[Notice]:
    angle = rays.widest_angle(fit.used)
    if angle < _NARROW:
        along = math.sqrt(float(np.linalg.eigvalsh(covariance)[-1]))
        yield Notice(
            "rays-nearly-parallel",
            f"point {shown(rays.name)}: its lines of sight meet at {angle:.2g} degrees only, so it "
            f"is uncertain by {along:.2g} (one sigma) along them; pick it in photographs taken "
            "further apart",
            point=rays.name,
            angle_deg=angle,
            std=along,
        )
