"""What the user should know of a terrain result, in words made of its final numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Iterator, Tuple

from ...types import AreaResult
from .budget import BASE_MISFIT

__all__ = ["Doubts", "words"]

#: Above this share nothing is said about gaps.
_FULL_SUPPORT = 0.95

#: A rim whose relief could be worth more than this share of the volume is worth a word.
_RELIEF_SHARE = 0.02


@dataclass(frozen=True)
class Doubts:
    """What was found on the way to a result that its numbers do not tell.

    Attributes
    ----------
    crossings : where the outline crosses channels and ridges, in words.
    lost_m2 : area beyond the edge of the cloud, on the ground.
    bare : share of the outline without points near, where the base depends on it.
    relief_m : RMS of the outline's heights about a plane, beyond noise, where the base is drawn
        through them.
    """

    crossings: Tuple[str, ...] = ()
    lost_m2: float = 0.0
    bare: float = 0.0
    relief_m: float = 0.0


def words(result: AreaResult, doubts: Doubts, *, compared: bool) -> Tuple[str, ...]:
    """Return what to warn of, one line each.

    Parameters
    ----------
    compared : whether the result stands beside those on other bases.
    """
    advice = "" if compared else " (--base plane follows the outline as it is)"
    return (
        *(crossing + advice for crossing in doubts.crossings),
        *_support(result, doubts),
        *_relief(result, doubts, compared),
    )


def _support(result: AreaResult, doubts: Doubts) -> Iterator[str]:
    if result.coverage is not None and result.coverage < _FULL_SUPPORT:
        yield (
            f"points support {result.coverage:.0%} of the area; the gaps were interpolated "
            "(see 'coverage' in the error budget)"
        )
    if doubts.lost_m2 > 0:
        yield (
            f"{doubts.lost_m2:.4g} m2 of the area lie beyond the edge of the cloud and were not "
            "measured; draw the area inside the cloud"
        )
    if doubts.bare > 1.0 - _FULL_SUPPORT:
        yield (
            f"{doubts.bare:.0%} of the outline have no points near; the base is interpolated "
            "along the outline there"
        )


def _relief(result: AreaResult, doubts: Doubts, compared: bool) -> Iterator[str]:
    total = (result.cut_m3 or 0.0) + (result.fill_m3 or 0.0)
    worth = BASE_MISFIT * doubts.relief_m * (result.area_m2 or 0.0)
    if doubts.relief_m > 0 and worth >= _RELIEF_SHARE * total:
        other = "compare it with the other bases" if compared else "try --base compare"
        yield (
            f"the ground along the outline is uneven ({doubts.relief_m:.2g} m RMS about a plane), "
            "and no outline tells what it does under the area; see 'base' in the error budget, "
            f"and {other}"
        )
