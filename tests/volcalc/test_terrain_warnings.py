"""What a terrain result says about itself."""

import math
from types import SimpleNamespace

import pytest

from quantify_client.types import BudgetItem
from quantify_client.volcalc.terrain.flanks import OnPile
from quantify_client.volcalc.terrain.layers import Layers
from quantify_client.volcalc.terrain.warnings import Findings, warnings_of


def said(findings=None, coverage=1.0, cut=100.0, compared=False, net=1.0):
    budget = [BudgetItem("survey", 30.0, 30.0, 0.0), BudgetItem("base", 2.5, 2.5, 0.0)]
    result = SimpleNamespace(
        volume_m3=net,
        std_m3=30.0,
        coverage=coverage,
        cut_m3=cut,
        fill_m3=0.0,
        budget=budget,
        area_m2=500.0,
    )
    return tuple(warnings_of(result, findings or Findings(), compared=compared))


def test_a_sound_result_has_no_warning():
    assert said(Findings(unsupported_rim=0.04, relief_m=0.1), cut=130.0) == ()


@pytest.mark.parametrize(
    ("findings", "code", "values", "begins"),
    [
        (
            Findings(crossings=((-1.5, 2.25),)),
            "outline-crosses-channel",
            {"height_m": -1.5, "length_m": 2.25},
            "the outline crosses a channel of 1.5 m over 2.2 m; the base goes straight across",
        ),
        (
            Findings(crossings=((0.8, 3.0),)),
            "outline-crosses-ridge",
            {"height_m": 0.8, "length_m": 3.0},
            "the outline crosses a ridge of 0.8 m over 3 m",
        ),
        (
            Findings(on_pile=OnPile(0.4, 0.5, 1.25, beyond=31.0)),
            "outline-on-pile",
            {"share": 0.4, "height_m": 0.5, "toe_m": 1.25},
            "40% of the outline lies on the pile itself, 0.5 m off the ground: its toe is ",
        ),
        (
            Findings(on_pile=OnPile(0.4, 0.5, math.nan, beyond=31.0)),
            "outline-on-pile",
            {"share": 0.4, "height_m": 0.5, "toe_m": None},
            "40% of the outline lies on the pile itself, 0.5 m off the ground: its toe is out ",
        ),
        (
            Findings(on_pile=OnPile(across=0.2)),
            "outline-crosses-neighbour",
            {"share": 0.2},
            "20% of the outline lies on another pile, a bank or plants",
        ),
        (
            Findings(layers=Layers(0.063, 2.57)),
            "two-surfaces",
            {"share": 0.063, "apart_m": 2.57, "layer": "upper"},
            "over 6.3% of the area there are two surfaces, one about 2.6 m above the other (trees "
            "or a roof over ground): the upper one was measured",
        ),
        (
            Findings(layers=Layers(0.5, 3.0), layer="mean"),
            "two-surfaces",
            {"share": 0.5, "apart_m": 3.0, "layer": "mean"},
            "over 50.0% of the area there are two surfaces, one about 3 m above the other (trees "
            "or a roof over ground): their mean was measured",
        ),
        (
            Findings(lost_m2=1.25),
            "area-beyond-cloud",
            {"area_m2": 1.25},
            "1.25 m2 of the area lie beyond the edge",
        ),
        (
            Findings(unsupported_rim=0.3),
            "outline-without-points",
            {"share": 0.3},
            "30% of the outline have no points near",
        ),
        (
            Findings(relief_m=0.2),
            "uneven-ground",
            {"relief_m": 0.2},
            "the ground around the area is uneven (0.2 m RMS",
        ),
    ],
)
def test_each_finding_has_its_warning(findings, code, values, begins):
    (notice,) = said(findings)
    assert (notice.code, notice.values) == (code, values)
    assert notice.startswith(begins)


def test_gaps_are_told_with_the_coverage_that_is_printed():
    (notice,) = said(coverage=0.87)
    assert notice.startswith("points support 87% of the area")
    assert (notice.code, notice.values) == ("gaps-interpolated", {"share": 0.87})


def test_nothing_advises_what_is_already_done():
    findings = Findings(relief_m=0.2)
    assert "try --base compare" in said(findings)[0]
    assert "--base" not in said(findings, compared=True)[0]
    assert "with the other bases" in said(findings, compared=True)[0]
    findings = Findings(crossings=((-1.0, 2.0),))
    advice = " (--base plane follows the outline as it is)"
    assert said(findings)[0] == said(findings, compared=True)[0] + advice
    advice = " (--layer lower or mean measures those)"
    assert advice in said(Findings(layers=Layers(0.5, 3.0)))[0]
    for layer in ("lower", "mean"):
        assert "--layer" not in said(Findings(layers=Layers(0.5, 3.0), layer=layer))[0]


def test_two_surfaces_that_are_not_sure_are_told_where_they_matter_and_no_wall_was_told():
    (notice,) = said(Findings(layers=Layers(maybe=(0.05, 1.3))))  # 32.5 m3 of 30
    assert (notice.code, notice.values["share"]) == ("two-surfaces", 0.05)
    assert "may be two surfaces" in notice
    assert not said(Findings(layers=Layers(maybe=(0.05, 1.1))))
    walled = said(Findings(layers=Layers(maybe=(0.05, 1.3)), at_wall=(0.3, 2.0)))
    assert [notice.code for notice in walled] == ["outline-at-wall"]


def test_the_error_of_the_base_is_weighed_against_the_volume_that_is_told():
    assert said(Findings(relief_m=0.2), cut=120.0)
    assert not said(Findings(relief_m=0.2), cut=130.0)  # 2.5 is 2 % of 125


def test_a_toe_that_leaves_out_less_than_the_uncertainty_is_not_told():
    assert said(Findings(on_pile=OnPile(0.4, 0.5, 1.25, beyond=29.0)), cut=130.0) == ()


def test_of_pits_it_is_the_edge():
    (notice,) = said(Findings(on_pile=OnPile(0.4, 0.5, 1.25, beyond=31.0)), net=-1.0)
    assert notice.startswith(
        "40% of the outline lies on the pit itself, 0.5 m off the ground: its edge"
    )
