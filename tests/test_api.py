"""The library as a program or a notebook meets it: names, signatures, results at hand."""

from __future__ import annotations

import dataclasses
import doctest
import inspect
import pickle
import sys
import types
from pathlib import Path
from typing import Any, Optional, Sequence, Union, get_type_hints

import numpy as np
import pytest
from commands import PILE, UTM
from terrains import circle, placed

import quantify_client
from quantify_client import Measurement, Options, change, describe, measure, scale
from quantify_client.crs import UNITS_M
from quantify_client.errors import MissingExtraError, UsageError
from quantify_client.options import (
    BASES,
    DEFAULT_BASE,
    METHOD_REVISION,
    METHOD_REVISIONS,
    OPTIONS,
    UNITS,
    read_options,
)
from quantify_client.scaler.adjustment.fit import MODES
from quantify_client.volcalc.terrain.base import KRIGED, SURFACES
from quantify_client.volcalc.terrain.integrate import MAX_SLICES

# Objects of the library: no different on a second Python.
pytestmark = pytest.mark.one_python

DOCS = Path(__file__).parent.parent / "docs"
API = DOCS / "api.md"


@pytest.fixture(scope="module")
def cloud(site):
    return site / "pile.laz"


@pytest.fixture(scope="module")
def two(cloud):
    """A pile, and an area beside the cloud."""
    features = [
        {"type": "Feature", "properties": {"name": name}, "geometry": shape.__geo_interface__}
        for name, shape in [("pile <1>", PILE.area), ("far", placed(circle(5, 5000, 5000)))]
    ]
    crs = {"type": "name", "properties": {"name": UTM}}
    return measure(cloud, area={"type": "FeatureCollection", "features": features, "crs": crs})


# --- names and signatures


def test_examples_of_the_manual_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options = doctest.IGNORE_EXCEPTION_DETAIL
    failed, tried = doctest.testfile(str(API), module_relative=False, optionflags=options)
    assert failed == 0
    assert tried > 20


def test_all_public_names_are_there_and_listed():
    assert dir(quantify_client) == sorted(quantify_client.__all__)
    for name in quantify_client.__all__:
        assert getattr(quantify_client, name) is not None
        assert f"`{name}`" in API.read_text()
    with pytest.raises(AttributeError, match="has no attribute 'meassure'"):
        quantify_client.meassure  # noqa: B018


def test_the_keywords_of_measure_are_the_options():
    parameters = inspect.signature(measure).parameters
    assert [name for name in parameters if name in OPTIONS] == list(OPTIONS)
    assert {*parameters} - {*OPTIONS} == {"sources", "align", "progress", "access"}
    hints, fields = get_type_hints(measure), get_type_hints(Options)
    for name, option in OPTIONS.items():
        assert parameters[name].default == option.default
        more = {
            "density": Optional[Union[float, str]],  # with its sigma, as on the command line
            "stage": Optional[Union[str, float, Sequence[float]]],
        }
        assert hints[name] == more.get(name, fields[name])
        assert name in measure.__doc__


@pytest.mark.parametrize("function", [change, scale, describe])
def test_keywords_of_the_other_functions_are_options_too(function):
    parameters = inspect.signature(function).parameters
    assert all(p.kind is not inspect.Parameter.VAR_KEYWORD for p in parameters.values())
    shared = {"crs", "source_unit", "vertical_unit"}
    assert parameters.keys() & OPTIONS.keys() >= shared
    for name in shared:
        assert parameters[name].default == OPTIONS[name].default


# --- options


def test_choices_are_what_the_stages_know():
    assert OPTIONS["base"].choices == (*BASES, "compare", "vertices", "ground")
    assert sorted(BASES) == sorted([KRIGED, *SURFACES])
    assert OPTIONS["scale_mode"].choices == tuple(MODES)
    assert OPTIONS["slices"].most == MAX_SLICES
    assert tuple(UNITS_M) == UNITS


def test_a_measurement_says_its_base_and_its_revision_of_the_method(two, cloud, monkeypatch):
    assert two.method_revision == METHOD_REVISION
    assert two[0].base == DEFAULT_BASE == BASES[0]
    monkeypatch.setattr("quantify_client.pipeline.common.METHOD_REVISION", 7)
    assert measure(cloud, area=PILE.area).to_dict()["method_revision"] == 7


def test_every_revision_of_the_method_is_explained():
    assert list(METHOD_REVISIONS) == [*range(1, METHOD_REVISION + 1)]
    text = (DOCS / "method.md").read_text()
    for revision, base in METHOD_REVISIONS.items():
        assert f"\n| {revision} | `{base}` | " in text


def test_every_option_is_explained_and_has_a_default_that_it_may_have():
    for name, option in OPTIONS.items():
        assert option.name == name
        assert option.help or option.title
        assert option.read(option.default) == option.default
    assert read_options({}) == Options()


@pytest.mark.parametrize(
    ("given", "density", "sigma"),
    [
        ({"density": "1.6:0.1"}, 1.6, 0.1),
        ({"density": "1.6"}, 1.6, 0.0),
        ({"density": 1.6, "density_sigma": 0.1}, 1.6, 0.1),
        ({"density": "1.6", "density_sigma": 0.2}, 1.6, 0.2),
    ],
)
def test_density_is_a_number_or_a_text(given, density, sigma):
    options = read_options(given)
    assert (options.density, options.density_sigma) == (density, sigma)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"layer": "middle"}, "--layer is middle; give upper, lower or mean"),
        ({"hollow": "yes"}, "--hollow is yes; give True or False"),
        ({"slices": True}, "--slices is True; give auto or 1 to 10000"),
        ({"slices": 10_001}, "give auto or 1 to 10000"),
        ({"max_gap": [1]}, r"--max-gap is \[1\]; give a length above 0"),
        ({"max_gap": "x" * 1000}, f"--max-gap is {'x' * 100}; give"),
        ({"base": float("inf")}, "ground or an elevation"),
        ({"threads": 257}, "give a number from 1 to 256"),
        ({"density": "1.6:"}, "the sigma of --density is ''; give"),
        ({"density": 1600.0}, "for 1600 kg/m3 give 1.6"),
        ({"source_unit": "inch"}, "give m, cm, mm, ft or us-ft"),
        ({"area_frame": "control"}, "--area-frame and --scale-mode go with --gcp"),
    ],
)
def test_what_an_option_may_not_be_is_said(given, said):
    with pytest.raises(UsageError, match=said):
        read_options(given)


def test_flags_of_numpy_are_flags_and_a_crs_is_a_text():
    assert read_options({"hollow": np.bool_(True)}).hollow is True
    with pytest.raises(UsageError, match="--crs is 32615; give EPSG:n, WKT"):
        read_options({"crs": 32615})
    with pytest.raises(UsageError, match="--density is ''; give"):
        read_options({"density": ""})


def test_numbers_of_numpy_are_numbers():
    read = read_options({"slices": np.int64(7), "max_gap": np.float32(0.5), "base": np.float64(99)})
    assert (read.slices, read.max_gap, read.base) == (7, 0.5, 99.0)
    assert {type(read.slices), type(read.max_gap)} == {int, float}
    with pytest.raises(UsageError, match="give auto or 1 to 10000"):
        read_options({"slices": np.float32(7.0)})
    with pytest.raises(UsageError, match=f"give {BASES[0]}, "):
        read_options({"base": np.zeros(3)})


def test_given_options_are_those_off_their_defaults():
    assert Options().given() == {}
    area = np.zeros((2, 2))  # no comparison of its own is asked
    assert Options(area=area, hollow=True, floor="auto").given() == {"area": area, "hollow": True}


# --- results at hand


def test_density_as_on_the_command_line(cloud):
    area = PILE.area
    text = measure(cloud, area=area, density="1.6:0.1")
    assert text == measure(cloud, area=area, density=1.6, density_sigma=0.1)
    assert text != measure(cloud, area=area, density=1.6)


def test_results_are_found_by_name_and_in_turn(two):
    assert [result.name for result in two] == ["pile <1>", "far"]
    assert len(two) == 2
    assert two["pile <1>"].volume_m3 > 0
    assert "outside the cloud" in two["far"].error
    with pytest.raises(KeyError, match="there is no result 'pile'; there are 'pile <1>', 'far'"):
        two["pile"]


def test_repr_is_one_short_line(two):
    told = repr(two)
    assert told.startswith(f"<Measurement of {two.source}: terrain, 2 results: pile <1> 26")
    assert " ± " in told
    assert "far not measured (lies outside" in told
    assert len(repr(two["pile <1>"])) < 20_000  # without the cells of its pictures


def test_a_notebook_shows_a_table(two):
    shown = two._repr_html_()
    assert "<td>pile &lt;1&gt;</td>" in shown
    assert shown.count("<tr>") == 3
    rows = [row.count("<td>") for row in shown.split("<tr>")[2:]]
    assert rows == [7, 7]


def test_equal_is_what_has_the_same_numbers(two, cloud):
    again = dataclasses.replace(two, provenance={"seconds": 5})
    assert again == two
    first, *rest = two.results
    other = dataclasses.replace(first, volume_m3=first.volume_m3 + 1e-9)
    assert dataclasses.replace(two, results=(other, *rest)) != two
    assert two != measure(cloud)
    assert pickle.loads(pickle.dumps(two)) == two  # noqa: S301


def test_numbers_without_a_unit_or_an_interval_are_shown_too(site):
    told = repr(measure(site / "body.xyz", method="polar"))
    assert "cubic units" in told
    assert "±" not in told


def test_to_dict_is_the_document(two):
    assert two.to_dict() == quantify_client.to_json(two)


class Frames(types.ModuleType):
    """What is asked of pandas and geopandas."""

    @staticmethod
    def DataFrame(rows):  # noqa: N802
        return rows

    class GeoDataFrame:
        @staticmethod
        def from_features(features, crs):
            return features, crs


def test_tables_have_a_row_for_each_result(two, site, monkeypatch):
    for name in ("pandas", "geopandas"):
        monkeypatch.setitem(sys.modules, name, Frames(name))
    first, second = two.to_dataframe()
    assert first["volume_m3"] == pytest.approx(two["pile <1>"].volume_m3)
    assert second["error"] == two["far"].error
    features, crs = two.to_geodataframe()
    assert crs == "OGC:CRS84"
    west, south = np.min(features[0]["geometry"]["coordinates"][0], axis=0)
    assert (west, south) == pytest.approx((-93, 45), abs=1)
    assert features[1]["geometry"] is None
    assert measure(site / "plain.csv", shape="terrain").to_geodataframe()[1] is None


def test_real_tables(two):
    pandas = pytest.importorskip("pandas")
    table = two.to_dataframe()
    assert isinstance(table, pandas.DataFrame)
    assert list(table["name"]) == ["pile <1>", "far"]
    geopandas = pytest.importorskip("geopandas")
    assert isinstance(two.to_geodataframe(), geopandas.GeoDataFrame)


def test_what_is_missing_for_a_table_is_said(two, monkeypatch):
    for name, ask in [("pandas", two.to_dataframe), ("geopandas", two.to_geodataframe)]:
        monkeypatch.setitem(sys.modules, name, None)
        with pytest.raises(MissingExtraError, match=f"this needs {name}, .*pip install {name}"):
            ask()


def test_a_measurement_is_still_a_dataclass(two):
    names: Any = [item.name for item in dataclasses.fields(Measurement)]
    assert names[:3] == ["source", "crs", "length_unit"]
