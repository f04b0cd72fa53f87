"""Which picks of a point are outliers, and how well all the others fit.

A pick is wrong when the others meet much better without it. With three photographs in one line a
wrong pick can leave every two of them meeting; which one is wrong is then not known, and said.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np
import numpy.typing as npt
from scipy.special import chdtri

from .rays import Intersection, NoIntersectionError, Rays, intersect

__all__ = ["Choice", "choose", "is_misfit", "pooled", "typical"]

_SHARP = float(chdtri(2, 1e-4))
"""Once in 10,000 the chi-square of good picks falls by more when one (two numbers) is removed."""
_TELLS = float(chdtri(2, 1e-2))
"""Two explanations nearer to each other than this cannot be told apart: likelihoods 1 to 100."""
_CHANCE = 1e-3
"""A point misses by more than chance where it would do so once in 1,000."""
_FEW = 3
"""Points that a median needs to resist one bad one."""
_ROUNDS = 20

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Choice:
    """The picks of a point that are used.

    Attributes
    ----------
    fit : to the picks used; None where even that does not exist.
    problem : why there is none.
    doubt : two picks one of which is wrong, where it is not known which.
    """

    fit: Optional[Intersection]
    problem: str = ""
    doubt: Optional[Tuple[int, int]] = None


def choose(rays: Rays, whole: Choice, sigma: float, spread: float) -> Choice:
    """Return the picks without the outliers: those whose removal cuts the chi-square sharply.

    Picks are removed one after another, the one that cuts most first, as long as more than half
    remain; then as many of them are believed as still cut it sharply against how well the rest
    fits. Looking from the end finds two wrong picks that hide each other.

    Parameters
    ----------
    rays : Rays
    whole : Choice
        The fit to all picks.
    sigma : float
        Of a pick, pixels.
    spread : float
        Chi-square per degree of freedom that other points have.
    """
    if len(rays) < 3 or _chi2(whole.fit, sigma) <= _SHARP:
        return whole
    steps: List[Tuple[Optional[Intersection], Intersection]] = []  # before and after a removal
    before, used = whole.fit, np.ones(len(rays), dtype=bool)
    while used.sum() - 1 > len(rays) / 2:
        best = min(_without_one(rays, used), key=lambda fit: fit.cost, default=None)
        if best is None:
            break
        steps.append((before, best))
        before, used = best, best.used
    doubt = None
    for before, after in reversed(steps):
        scale = max(1.0, spread, _chi2(after, sigma) / after.degrees_of_freedom)
        if _chi2(before, sigma) - _chi2(after, sigma) <= _SHARP * scale:
            continue
        doubt = _interchangeable(rays, after, _TELLS * scale * sigma**2)
        if doubt is None:
            return Choice(after)
    return Choice(whole.fit, whole.problem, doubt)


def _without_one(rays: Rays, used: Mask) -> Iterator[Intersection]:
    for index in np.flatnonzero(used):
        fewer = used.copy()
        fewer[index] = False
        try:
            yield intersect(rays, fewer)
        except NoIntersectionError:
            continue


def _interchangeable(rays: Rays, fit: Intersection, margin: float) -> Optional[Tuple[int, int]]:
    """Return a pick left out and one kept that could change places at almost no cost."""
    for wrong in np.flatnonzero(~fit.used):
        swapped = fit.used.copy()
        swapped[wrong] = True
        for other in _without_one(rays, swapped):
            if other.used[wrong] and other.cost - fit.cost <= margin:
                (kept,) = np.flatnonzero(swapped & ~other.used)
                return int(wrong), int(kept)
    return None


def _chi2(fit: Optional[Intersection], sigma: float) -> float:
    return math.inf if fit is None else fit.cost / sigma**2


def typical(fits: Sequence[Optional[Intersection]], sigma: float) -> float:
    """Return the median of the points' chi-square per degree of freedom, which is robust."""
    ratios = sorted(
        _chi2(fit, sigma) / float(chdtri(fit.degrees_of_freedom, 0.5))
        for fit in fits
        if fit is not None
    )
    return max(1.0, ratios[(len(ratios) - 1) // 2]) if len(ratios) >= _FEW else 1.0


def is_misfit(fit: Intersection, sigma: float, spread: float) -> bool:
    """Whether a point is missed by more than chance, given the spread of the others."""
    return _chi2(fit, sigma) > float(chdtri(fit.degrees_of_freedom, _CHANCE)) * spread


def pooled(fits: Mapping[str, Intersection], sigma: float) -> float:
    """Return chi-square per degree of freedom of all points that miss by no more than chance.

    Never below 1. A single point has one to a few degrees of freedom, whose chi-square alone says
    little; together they say how good the picks and the cameras really are.
    """
    spread = typical(list(fits.values()), sigma)
    for _ in range(_ROUNDS):
        good = [fit for fit in fits.values() if not is_misfit(fit, sigma, spread)]
        freedom = sum(fit.degrees_of_freedom for fit in good)
        total = sum(_chi2(fit, sigma) for fit in good)
        following = max(1.0, total / freedom) if freedom else 1.0
        if following == spread:
            break
        spread = following
    return spread
