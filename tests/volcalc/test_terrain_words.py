"""What a terrain result says about itself."""

from types import SimpleNamespace

import pytest

from quantify_client.volcalc.terrain.warnings import Doubts, words


def said(doubts=None, coverage=1.0, cut=100.0, compared=False):
    result = SimpleNamespace(coverage=coverage, cut_m3=cut, fill_m3=0.0, area_m2=50.0)
    return words(result, doubts or Doubts(), compared=compared)


def test_a_sound_result_is_not_worth_a_word():
    assert said(Doubts(bare=0.04, relief_m=0.1)) == ()


@pytest.mark.parametrize(
    ("doubts", "begins"),
    [
        (Doubts(crossings=("the outline crosses a channel",)), "the outline crosses a channel"),
        (Doubts(lost_m2=1.25), "1.25 m2 of the area lie beyond the edge"),
        (Doubts(bare=0.3), "30% of the outline have no points near"),
        (Doubts(relief_m=0.2), "the ground along the outline is uneven (0.2 m RMS"),
    ],
)
def test_each_doubt_has_its_words(doubts, begins):
    (line,) = said(doubts)
    assert line.startswith(begins)


def test_gaps_are_told_with_the_coverage_that_is_printed():
    assert said(coverage=0.87)[0].startswith("points support 87% of the area")


def test_nothing_advises_what_is_already_done():
    doubts = Doubts(relief_m=0.2)
    assert "try --base compare" in said(doubts)[0]
    assert "--base" not in said(doubts, compared=True)[0]
    assert "with the other bases" in said(doubts, compared=True)[0]
    doubts = Doubts(crossings=("the base goes straight across",))
    assert said(doubts) == (
        "the base goes straight across (--base plane follows the outline as it is)",
    )
    assert said(doubts, compared=True) == doubts.crossings


def test_the_relief_is_weighed_against_the_volume_that_is_told():
    assert said(Doubts(relief_m=0.2), cut=120.0)
    assert not said(Doubts(relief_m=0.2), cut=130.0)  # 0.25 * 0.2 * 50 is 2 % of 125
