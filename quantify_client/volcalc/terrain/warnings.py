"""The warnings of a terrain result, made of its final numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Iterator, Tuple

from ...options import DEFAULT_LAYER
from ...types import AreaResult, Notice
from .coverage import FULL_SUPPORT
from .flanks import NOT_ON_PILE, OnPile
from .layers import NO_LAYERS, Layers
from .rim import LEAST_SHARE

__all__ = ["OUTLINE_ON_PILE", "Findings", "warnings_of"]

#: The codes of warnings after which another outline is proposed.
OUTLINE_ON_PILE = frozenset({"outline-on-pile", "outline-crosses-neighbour"})

#: There is a warning where the standard deviation of the base is more than this share of cut and
#: fill.
_BASE_SHARE = 0.02

#: Two surfaces over a smaller share of an area are told as 0.0 % of it, and change nothing.
_SHOWN_SHARE = 0.0005

#: The ground lies off a design as a whole where its median does by so many standard deviations of
#: the heights themselves: nearly all of it is then on one side.
_AS_A_WHOLE = 3.0


@dataclass(frozen=True)
class Findings:
    """What was found on the way to a result and is not among its numbers.

    Attributes
    ----------
    crossings : height (negative for a channel, positive for a ridge) and length of each stretch
        of the outline where the base goes straight across, metres.
    lost_m2 : area beyond the edge of the cloud, on the ground.
    unsupported_rim : share of the outline without points near, where the base depends on it.
    relief_m : RMS of the ground's heights around the area about a plane.
    on_pile : which shares of the outline lie on a pile.
    at_wall : share of the outline beside a wall, and the height of that, metres.
    layers : how much of the area has two surfaces, and the one that was measured.
    off_given : how far the ground around lies above a design, its scatter, and on what area.
    """

    crossings: Tuple[Tuple[float, float], ...] = ()
    lost_m2: float = 0.0
    unsupported_rim: float = 0.0
    relief_m: float = 0.0
    on_pile: OnPile = NOT_ON_PILE
    at_wall: Tuple[float, float] = (0.0, 0.0)
    layers: Layers = NO_LAYERS
    layer: str = DEFAULT_LAYER
    off_given: Tuple[float, float, float] = (0.0, 0.0, 0.0)


def warnings_of(result: AreaResult, findings: Findings, *, compared: bool) -> Iterator[Notice]:
    """Yield the warnings of a result.

    Parameters
    ----------
    compared : whether the result stands beside those on other bases.
    """
    pit, std = (result.volume_m3 or 0.0) < 0, result.std_m3 or 0.0
    yield from _of_outline(findings, pit, std)
    yield from _of_unsure_layers(findings, result)
    yield from _of_crossings(findings, compared)
    if result.coverage is not None and result.coverage < FULL_SUPPORT:
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
    if findings.unsupported_rim > 1.0 - FULL_SUPPORT:
        yield Notice(
            "outline-without-points",
            f"{findings.unsupported_rim:.0%} of the outline have no points near; the base is "
            "interpolated along the outline there",
            share=findings.unsupported_rim,
        )
    yield from _of_given(findings)
    total = (result.cut_m3 or 0.0) + (result.fill_m3 or 0.0)
    base = sum(item.std_m3 for item in result.budget or () if item.source == "base")
    if findings.relief_m > 0 and base >= _BASE_SHARE * total:
        other = "compare it with the other bases" if compared else "try --base compare"
        yield Notice(
            "uneven-ground",
            f"the ground around the area is uneven ({findings.relief_m:.2g} m RMS about a plane): "
            "what lies under the area is known to that extent only; see 'base' in the error "
            f"budget, and {other}",
            relief_m=findings.relief_m,
        )


def _of_given(findings: Findings) -> Iterator[Notice]:
    """Yield that the ground around lies off a design as a whole, and not here and there."""
    off, scatter, area = findings.off_given
    if abs(off) > _AS_A_WHOLE * scatter:
        yield Notice(
            "base-off-ground",
            f"at the area the ground lies {abs(off):.3g} m {'above' if off > 0 else 'below'} "
            f"the base that was given ({area:.3g} m2 around it, scatter {scatter:.2g} m): if it "
            "should lie on it, the heights of the two differ; check their datums and units",
            off_m=off,
            scatter_m=scatter,
            area_m2=area,
        )


def _of_outline(findings: Findings, pit: bool, std: float) -> Iterator[Notice]:
    """Yield what the outline is on, and two surfaces, first what concerns more."""
    found = findings.on_pile
    # Of a pile and of a step the step is told first.
    told = [
        (findings.at_wall[0], _of_walls(*findings.at_wall)),
        (found.sloping, _of_pile(found, pit, std)),
        (found.across, _of_others(found, pit)),
        (findings.layers.share, _of_layers(findings)),
    ]
    for _, notices in sorted(told, key=lambda each: -each[0]):
        yield from notices


def _of_pile(found: OnPile, pit: bool, std: float) -> Iterator[Notice]:
    """Yield that the outline is on the pile, if that is more than the volume is uncertain by."""
    what, end = ("pit", "edge") if pit else ("pile", "toe")
    if found.is_beyond(std):
        out_of_sight = math.isnan(found.toe)
        far = "out of sight" if out_of_sight else f"about {found.toe:.2g} m further out"
        yield Notice(
            "outline-on-pile",
            f"{found.share:.0%} of the outline lies on the {what} itself, "
            f"{abs(found.height):.2g} m off the ground: its {end} is {far}, and what lies between "
            f"is not in the volume; draw the outline beyond the {end}",
            share=found.share,
            height_m=found.height,
            toe_m=None if out_of_sight else found.toe,
        )


def _of_others(found: OnPile, pit: bool) -> Iterator[Notice]:
    if found.is_across:
        other = "another pit" if pit else "another pile, a bank or plants"
        yield Notice(
            "outline-crosses-neighbour",
            f"{found.across:.0%} of the outline lies on {other}, which is in the volume as far as "
            "the outline goes; draw the outline between the two",
            share=found.across,
        )


def _of_walls(share: float, height: float) -> Iterator[Notice]:
    if share > LEAST_SHARE:
        yield Notice(
            "outline-at-wall",
            f"{share:.0%} of the outline runs along a wall or bank of about "
            f"{height:.2g} m: the base comes from the ground along the rest; draw the outline on "
            "the ground beyond it if it belongs to what is measured, as the walls of a pit do",
            share=share,
            height_m=height,
        )


def _of_layers(findings: Findings) -> Iterator[Notice]:
    """Yield that parts of the area have two surfaces, and which of them was measured."""
    found, layer = findings.layers, findings.layer
    if found.share >= _SHOWN_SHARE:
        measured = "their mean" if layer == "mean" else f"the {layer} one"
        # Who has chosen one needs no advice.
        advice = " (--layer lower or mean measures those)" if layer == DEFAULT_LAYER else ""
        yield Notice(
            "two-surfaces",
            f"over {found.share:.1%} of the area there are two surfaces, one about "
            f"{found.apart:.2g} m above the other (trees or a roof over ground): {measured} was "
            f"measured{advice}",
            share=found.share,
            apart_m=found.apart,
            layer=layer,
        )


def _of_unsure_layers(findings: Findings, result: AreaResult) -> Iterator[Notice]:
    """Yield that there may be two surfaces, if what is between them is beyond the uncertainty.

    Beside walls, which are told, it is these.
    """
    share, apart = findings.layers.maybe
    if findings.at_wall[0] or share * apart * (result.area_m2 or 0.0) <= (result.std_m3 or 0.0):
        return
    yield Notice(
        "two-surfaces",
        f"over {share:.1%} of the area there may be two surfaces, one about {apart:.2g} m above "
        "the other (trees or a roof over ground), or a box or wall: too few points tell, and all "
        "were measured as one surface; look at the cloud there, and leave out of the outline what "
        "is not to be measured",
        share=share,
        apart_m=apart,
        layer="mean",
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
