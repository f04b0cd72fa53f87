"""Options of a task: presets, what the user overrides, and what a node would refuse or ignore."""

import pytest
from nodeodm import OPTIONS
from pyodm.types import NodeOption

from quantify_client.errors import UsageError
from quantify_client.sfm.odm.layout import MINIMAL_OUTPUTS
from quantify_client.sfm.servers.presets import PRESETS, choose_options

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

AVAILABLE = [NodeOption(**option) for option in OPTIONS]


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_are_options_that_nodes_have(preset):
    chosen, notes = choose_options(AVAILABLE, preset)
    assert chosen == dict(PRESETS[preset])
    assert notes == ()
    assert chosen["dsm"] is True


def test_presets_differ_in_what_takes_time():
    qualities = [PRESETS[name]["pc-quality"] for name in ("fast", "default", "best")]
    assert qualities == ["low", "medium", "high"]


def test_ground_base_asks_for_classes():
    assert choose_options(AVAILABLE, ground=True)[0]["pc-classify"] is True
    assert "pc-classify" not in choose_options(AVAILABLE)[0]


def test_user_overrides_preset_and_ground():
    chosen, _ = choose_options(AVAILABLE, given={"dsm": "false", "pc-classify": "0"}, ground=True)
    assert chosen["dsm"] is False
    assert chosen["pc-classify"] is False


def test_split_and_option_split():
    assert choose_options(AVAILABLE, split=300)[0]["split"] == 300
    assert choose_options(AVAILABLE, given={"split": "50"}, split=300)[0]["split"] == 50


@pytest.mark.parametrize(
    ("name", "value", "found"),
    [
        ("dsm", "yes", True),
        ("dsm", True, True),
        ("crop", "2.5", 2.5),
        ("split", "40", 40),
        ("split", "40.0", 40),
        ("pc-quality", "ultra", "ultra"),
        ("pc-rectify", 10, 10),
        ("boundary", "{}", "{}"),
    ],
)
def test_values_become_what_the_option_is(name, value, found):
    chosen = choose_options(AVAILABLE, given={name: value})[0][name]
    assert chosen == found
    assert type(chosen) is type(found) or isinstance(chosen, (int, float))


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("dsm", "maybe", "bool"),
        ("crop", "-1", "positive float"),
        ("crop", "nan", "positive float"),
        ("crop", "wide", "positive float"),
        ("crop", "", "positive float"),
        ("split", "1.5", "positive integer"),
        ("split", True, "positive integer"),
        ("pc-quality", "best", "ultra, high, medium"),
        ("pc-rectify", "10.1", "0 <= x <= 10"),
        ("boundary", "{", "json"),
    ],
)
def test_values_that_do_not_fit_are_refused(name, value, expected):
    with pytest.raises(UsageError, match=expected):
        choose_options(AVAILABLE, given={name: value})


@pytest.mark.parametrize(
    ("name", "near"),
    [("pc-qualty", "pc-quality"), ("PC_Quality", "pc-quality"), ("--dsm", "dsm"), ("dem", "dsm")],
)
def test_near_names_are_suggested(name, near):
    with pytest.raises(UsageError, match=f"did you mean .*{near}"):
        choose_options(AVAILABLE, given={name: "1"})


def test_far_name_and_wrong_preset():
    with pytest.raises(UsageError, match="/options"):
        choose_options(AVAILABLE, given={"xyzzy": 1})
    with pytest.raises(UsageError, match="fast, default, best"):
        choose_options(AVAILABLE, "slow")


@pytest.mark.parametrize(
    ("domain", "value", "fits"),
    [
        ("integer >= 3", 3, True),
        ("integer > 3", 3, False),
        ("float <= 3", 3.5, False),
        ("float < 3", 2.5, True),
        ("percent", 101, False),
        ("percent", 100, True),
        ("a domain of later days", 7, True),
        ("", 7, True),
    ],
)
def test_domains(domain, value, fits):
    option = NodeOption(domain, "", "x", "0", "float")
    try:
        choose_options([option], given={"x": value})
    except UsageError:
        assert not fits
    else:
        assert fits


def test_minimal_outputs_are_relative_paths_with_the_cloud_and_the_cameras():
    assert "odm_georeferencing/odm_georeferenced_model.laz" in MINIMAL_OUTPUTS
    assert "odm_report/shots.geojson" in MINIMAL_OUTPUTS
    assert "cameras.json" in MINIMAL_OUTPUTS
    assert not any(path.startswith(("/", "..")) for path in MINIMAL_OUTPUTS)
