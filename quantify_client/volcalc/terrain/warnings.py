"""The warnings of a terrain result, made of its final numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Iterator, Tuple

from ...types import AreaResult, Notice
from .budget import BASE_MISFIT

__all__ = ["Findings", "warnings_of"]

#: Above this share there is no warning about gaps.
_FULL_SUPPORT = 0.95

#: There is a warning where the relief of the rim may change the volume by more than this share.
_RELIEF_SHARE = 0.02


@dataclass(frozen=True)
class Findings:
    """What was found on the way to a result and is not among its numbers.

    Attributes
    ----------
    crossings : height (negative for a channel, positive for a ridge) and length of each stretch
        of the outline where the base goes straight across, metres.
    lost_m2 : area beyond the edge of the cloud, on the ground.
    unsupported_rim : share of the outline without points near, where the base depends on it.
    relief_m : RMS of the outline's heights about a plane, beyond noise, where the base is drawn
        through them.
    """

    crossings: Tuple[Tuple[float, float], ...] = ()
    lost_m2: float = 0.0
    unsupported_rim: float = 0.0
    relief_m: float = 0.0


def warnings_of(result: AreaResult, findings: Findings, *, compared: bool) -> Iterator[Notice]:
    """Yield the warnings of a result.

    Parameters
    ----------
    compared : whether the result stands beside those on other bases.
    """
    yield from _of_crossings(findings, compared)
    if result.coverage is not None and result.coverage < _FULL_SUPPORT:
        yield Notice(
            "gaps-interpolated",
            f"points support {result.coverage:.0%} of the area; the gaps were interpolated "
            "(see 'coverage' in the error budget)",
            share=result.coverage,
        )
    if findings.lost_m2 > 0:
        yield Notice(
            "area-beyond-cloud",
            f"{findings.lost_m2:.4g} m2 of the area lie beyond the edge of the cloud and were not "
            "measured; draw the area inside the cloud",
            area_m2=findings.lost_m2,
        )
    if findings.unsupported_rim > 1.0 - _FULL_SUPPORT:
        yield Notice(
            "outline-without-points",
            f"{findings.unsupported_rim:.0%} of the outline have no points near; the base is "
            "interpolated along the outline there",
            share=findings.unsupported_rim,
        )
    total = (result.cut_m3 or 0.0) + (result.fill_m3 or 0.0)
    worth = BASE_MISFIT * findings.relief_m * (result.area_m2 or 0.0)
    if findings.relief_m > 0 and worth >= _RELIEF_SHARE * total:
        other = "compare it with the other bases" if compared else "try --base compare"
        yield Notice(
            "uneven-outline",
            f"the ground along the outline is uneven ({findings.relief_m:.2g} m RMS about a "
            "plane): how it continues under the area is not known; see 'base' in the error budget, "
            f"and {other}",
            relief_m=findings.relief_m,
        )


def _of_crossings(findings: Findings, compared: bool) -> Iterator[Notice]:
    advice = "" if compared else " (--base plane follows the outline as it is)"
    for height, length in findings.crossings:
        what = "a channel" if height < 0 else "a ridge"
        yield Notice(
            "outline-crosses-channel" if height < 0 else "outline-crosses-ridge",
            f"the outline crosses {what} of {abs(height):.2g} m over {length:.2g} m; the base goes "
            f"straight across{advice}",
            height_m=height,
            length_m=length,
        )
