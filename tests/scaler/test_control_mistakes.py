"""Control files: one line for every mistake, and nothing else for anything at all."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path

import pytest
import yaml
from controls import EXAMPLE, GCP_LIST, as_json, one_line, refusal
from hypothesis import given
from hypothesis import strategies as st

from quantify_client.errors import ControlError
from quantify_client.scaler.control import syntax as trees
from quantify_client.scaler.control.read import read_control

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

# --- mistakes


def points(entry: str, head: str = "unit: m") -> str:
    return f"{head}\npoints:\n  A: {{{entry}}}\n"


def bar(entry: str, head: str = "unit: m") -> str:
    cloud = "cloud: {P: {xyz: [0, 0, 0]}, Q: {xyz: [1, 0, 0]}}"
    return f"{head}\n{cloud}\nscale_bars:\n  - {{{entry}}}\n"


def tape(entry: str) -> str:
    return bar(entry).replace("scale_bars", "distances")


HERE = "lat: 34.4, lon: -119.8"
LENGTH = "from: P, to: Q, length: 2"
MISTAKES = [
    # the file
    ("# nothing\n", "is empty"),
    ("---\n", "is empty"),
    ("{}", "is empty"),
    ("points:\ncloud:\n", "is empty"),
    ("just words", "expected a mapping"),
    ("- 1\n- 2\n", "expected a mapping"),
    ("unit: m\npoints: }\n", "line 2: not valid YAML"),
    ("points:\n\tA: 1\n", "blanks, not with tabs"),
    ("a: 1\n---\nb: 2\n", "line 2: a second document"),
    ("a: &x 1\n", "line 1: anchors"),
    ("a: *x\n", "line 1: anchors"),
    ("a: !!python/object/apply:os.system [x]\n", "line 1: tags"),
    ("unit: m\nunit: ft\n", "line 2: 'unit' is there a second time"),
    ("points:\n  A: {lat: 1, lon: 2}\n  A: {lat: 1, lon: 2}\n", "line 3: 'A' is there"),
    ("points:\n  'A ': {lat: 1, lon: 2}\n  A: {lat: 1, lon: 2}\n", "'A' is there already"),
    ("? [a, b]\n: 1\n", "stands where a name is expected"),
    ("points: " + "[" * 20 + "]" * 20, "nested too deeply"),
    ("Points: {}\n", "did you mean 'points'?"),
    ("distance: []\n", "did you mean 'distances'?"),
    ("wxyz: red\n", "'wxyz' is no key of this; expected crs, unit, height"),
    # unit and CRS
    ("unit: feet\n", "unit is 'feet': did you mean 'ft'?"),
    ("unit: furlong\n", "unit is 'furlong': expected m, ft, us-ft"),
    ("unit: [m]\n", "unit is a list"),
    ("height: 3\ncloud: {A: {xyz: [1, 2, 3]}}", "height is 3, but of what unit?"),
    (points(f"{HERE}, accuracy: 3", "crs: EPSG:4326"), "line 3, points.A: accuracy is 3, but"),
    (points(f"{HERE}, elevation: 3", "crs: EPSG:4326"), "elevation is 3, but of what unit?"),
    (bar(LENGTH, "# no unit"), "length is 2, but of what unit?"),
    ("crs: EPSG:999999\n", "control.yaml: crs: unknown CRS 'EPSG:999999'"),
    ("crs: {a: b}\n", "crs is a mapping"),
    ("crs: EPSG:5703\n", "or a map projection, such as"),
    ("crs: EPSG:4978\n", "or a map projection, such as"),
    ("crs: EPSG:4807\n", "counts longitude and latitude in grad"),
    (points(HERE, "crs: EPSG:32611"), "EPSG:32611 is a projected CRS; give easting"),
    (points("easting: 5, northing: 6", "crs: EPSG:4326"), "EPSG:4326 has none; add the crs"),
    (points("easting: 5, northing: 6"), "there is no crs; add the crs"),
    (points("easting: 34.4, northing: 19", "crs: EPSG:32611"), "looks like degrees"),
    # points
    ("points: [A, B]\n", "points is a list: expected names"),
    ("points:\n  A: 34.4, -119.8\n", "points.A: '34.4, -119.8' stands where keys and values"),
    ("points:\n  A:\n", "neither a position nor an elevation"),
    ("points:\n  '': {lat: 1, lon: 2}\n", "'': a point needs a name"),
    ("points:\n  '   ': {lat: 1, lon: 2}\n", "a point needs a name"),
    (f"points:\n  {'x' * 101}: {{lat: 1, lon: 2}}\n", "100 characters, this one has 101"),
    ('points:\n  "a\\tb": {lat: 1, lon: 2}\n', "control characters"),
    (points("lat: 34.4"), "lon is missing"),
    (points("lon: 34.4"), "lat is missing"),
    (points("lat: -119.8, lon: 34.4"), "seem to be swapped"),
    (points("lat: 91, lon: 100"), "lat is 91: expected -90 to 90"),
    (points("lat: 34.4, lon: -190"), "lon is -190: expected -180 to 180"),
    (points("lat: 0, lon: 0.0"), "in the sea"),
    (points(f"{HERE}, easting: 2"), "keep the pair"),
    (points("lat: abc, lon: 2"), "lat is 'abc': expected a number"),
    (points("lat: 34:24:29, lon: 2"), "not degrees, minutes and seconds"),
    (points('lat: "34°24\'29.9", lon: 2'), "not degrees, minutes and seconds"),
    (points("lat: '34,408', lon: 2"), "a decimal comma; write 34.408"),
    (points("lat: 34,408, lon: 2"), "'408' is no key of this; write numbers with points"),
    (points("lat: .nan, lon: 2"), "lat is '.nan': expected a number"),
    (points("lat: nan, lon: 2"), "lat is 'nan': expected a number"),
    (points("lat: .inf, lon: 2"), "lat is '.inf'"),
    (points("lat: 1e999, lon: 2"), "lat is '1e999'"),
    (points("lat: 1_0, lon: 2"), "lat is '1_0'"),
    (points("lat: [1], lon: 2"), "lat is a list"),
    (points("lat: {a: 1}, lon: 2"), "lat is a mapping"),
    (points(f"{HERE}, acuracy: 3"), "did you mean 'accuracy'?"),
    (points("latitude: 1, lon: 2"), "did you mean 'lat'?"),
    (points(f"{HERE}, accuracy: 0"), "accuracy is 0: expected one standard deviation"),
    (points(f"{HERE}, accuracy: -3"), "accuracy is -3"),
    (points(f"{HERE}, accuracy: 1e-300"), "accuracy is 1e-300"),
    (points(f"{HERE}, accuracy: 1e9"), "absurdly large"),
    (points(f"{HERE}, elevation_accuracy: 1"), "elevation_accuracy and no elevation"),
    (points("elevation: 3, accuracy: 1"), "an accuracy and no position"),
    (points(f"{HERE}, elevation: 30000"), "no height on the Earth"),
    (points(f"{HERE}, elevation: 12 m"), "write the number alone"),
    (points("easting: 1e12, northing: 5", "crs: EPSG:32611"), "absurdly large"),
    (points("easting: 9e9, northing: 9e9", "crs: EPSG:32611"), "control.yaml: "),
    # the cloud
    ("cloud:\n  A: {}\n", "xyz is missing: expected three numbers"),
    ("cloud:\n  A: {xyz: [1, 2]}\n", "xyz is a list of 2: expected three numbers"),
    ("cloud:\n  A: {xyz: [1,5, 2,0, 3]}\n", "a list of 5: expected three numbers"),
    ("cloud:\n  A: {xyz: 1 2 3}\n", "xyz is '1 2 3'"),
    ("cloud:\n  A: {xyz: [1, 2, x]}\n", "xyz is 'x': expected a number"),
    ("cloud:\n  A: {xyz: [1, 2, [3]]}\n", "xyz is a list"),
    ("cloud:\n  A: {xyz: [1, 2, 3], accuracy: 0}\n", "accuracy is 0"),
    ("cloud:\n  A: [1, 2, 3]\n", "cloud.A: a list stands where"),
    # distances and bars
    (tape("from: P, to: Q, length: 0"), "line 4, distances[1] (P-Q): length is 0"),
    (tape("from: P, to: Q, length: -2"), "length is -2: expected a distance of more than 0"),
    (tape("from: P, to: Q, length: 100001"), "between 1 micrometre and 100 km"),
    (tape("from: P, to: Q"), "length is missing"),
    (tape("from: P, to: Q, length: "), "length is missing"),
    (tape("from: P, length: 2"), "to is missing: expected the name of a point"),
    (tape('from: P, to: "Q\\0", length: 2'), "to is 'Q\\x00': a name may not have control"),
    (tape("from: P, to: [Q], length: 2"), "to is a list: expected the name"),
    (tape("from: P, to: P, length: 2"), "begins and ends at the same point"),
    (tape("from: P, to: Z, length: 2"), "(P-Z): 'Z' is in none of points, cloud and images"),
    (tape("from: P, to: q, length: 2"), "did you mean 'Q'?"),
    (tape(f"{LENGTH}, higher: R"), "higher is 'R': expected P or Q"),
    (tape(f"{LENGTH}, check: maybe"), "check is 'maybe': expected true or false"),
    (tape(f"{LENGTH}, accuracy: 0"), "accuracy is 0"),
    (bar(f"{LENGTH}, check: true"), "'check' is no key of this"),
    (bar("from: P, to: Z, length: 2"), "line 4, scale_bars[1] (P-Z)"),
    ("unit: m\ndistances: {A: 1}\n", "distances is a mapping: expected a list"),
    ("unit: m\ndistances: [A]\n", "distances[1]: 'A' stands where"),
    # other files
    ("points: nowhere.csv\n", "nowhere.csv does not exist"),
    ("points: .\n", "is a folder"),
    ('points: "a\\nb"\n', "expected its entries, or the path of a file"),
    (f"points: {'x' * 2000}\n", "expected its entries, or the path"),
    (f"points: {'x' * 999}\n", "cannot be read: File name too long"),
    ("images: nowhere.txt\n", "nowhere.txt does not exist"),
    ("images: [a.txt]\n", "images is a list: expected the path"),
]


@pytest.mark.parametrize(("text", "fragment"), MISTAKES)
def test_mistake_is_named_in_one_line(text: str, fragment: str, tmp_path: Path) -> None:
    assert fragment in refusal(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "fragment"),
    [
        ("", "is empty"),
        ("  \n", "is empty"),
        ("null", "is empty"),
        ("[1]", "expected a mapping"),
        ('{"points": ', "line 1: not valid JSON"),
        ('{"unit": "m", "unit": "ft"}', "'unit' is there twice"),
        ('{"height": NaN}', "NaN is not a number"),
        ('{"height": -Infinity}', "-Infinity is not a number"),
        ('{"points": {"A": {"lat": "nan", "lon": 2}}}', "lat is 'nan'"),
        ('{"points": {"A": {"lat": true, "lon": 2}}}', "lat is 'true'"),
        ('{"points": {"A": {"lat": ' + "1" * 5000 + ', "lon": 2}}}', "lat is '1111"),
        ('{"cloud": {"\\ud800": {"xyz": [1, 2, 3]}}}', "control characters"),
        ('{"points": ' + "[" * 9 + "]" * 9 + "}", "nested too deeply"),
        ("[" * 100_000, "nested too deeply"),
    ],
)
def test_mistake_in_json_is_named_in_one_line(text: str, fragment: str, tmp_path: Path) -> None:
    assert fragment in refusal(tmp_path, text, "control.json")


@pytest.mark.parametrize(
    ("data", "fragment"),
    [
        (b"\x00\x01\x02\xff\xfe" * 40, "is binary"),
        (b"points:\x00", "is binary"),
        (b"\xff\xfe\x00", "is binary"),
        ("points: {Höhe: 1}".encode("latin-1"), "not in UTF-8"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\n", "git lfs pull"),
        (b"<!DOCTYPE html><html>", "web page"),
        (b"#" * 10_000_001, "larger than 10 MB"),
        (b"unit: m\x07\n", "not valid YAML"),
    ],
)
def test_other_files_are_recognised(data: bytes, fragment: str, tmp_path: Path) -> None:
    (tmp_path / "control.yaml").write_bytes(data)
    with pytest.raises(ControlError, match=fragment) as caught:
        read_control(tmp_path / "control.yaml")
    one_line(caught.value)


def test_missing_file_folder_and_device(tmp_path: Path) -> None:
    for path, fragment in (
        (tmp_path / "nowhere.yaml", "does not exist"),
        (tmp_path, "is a folder"),
        (Path("/dev/zero"), "is not a file"),
        (tmp_path / "a\nb.yaml", "does not exist"),
        (tmp_path / "a\x00b.yaml", "control"),
    ):
        with pytest.raises(ControlError, match=fragment) as caught:
            read_control(path)
        one_line(caught.value)


def test_billion_laughs_are_refused_at_once(tmp_path: Path) -> None:
    lines = ["a: &a [lol, lol, lol, lol, lol, lol, lol, lol, lol]"]
    for before, letter in zip("abcdefgh", "bcdefghi"):
        lines.append(f"{letter}: &{letter} [{', '.join([f'*{before}'] * 9)}]")
    start = time.process_time()
    assert "anchors" in refusal(tmp_path, "\n".join(lines))
    assert time.process_time() - start < 1.0


@pytest.mark.parametrize("loader", ["CBaseLoader", "BaseLoader"])
@pytest.mark.parametrize("opening", ["[", "{", "[{", "[ ", "{a: ", "- "])
def test_deep_yaml_is_refused_at_once(
    opening: str, loader: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also by a libyaml that gives up in its own words before an event tells the depth."""
    monkeypatch.setattr(trees, "_LOADER", getattr(yaml, loader))
    start = time.process_time()
    assert "line 2: nested too deeply" in refusal(tmp_path, "points:\n " + opening * 100_000)
    assert time.process_time() - start < 5.0


def test_brackets_in_a_text_are_no_nesting(tmp_path: Path) -> None:
    assert "is no key of this" in refusal(tmp_path, f"'{'[' * 20}': 1\n")


def test_counts_are_capped(tmp_path: Path) -> None:
    many = "".join(f"  p{i}: {{xyz: [{i}, 0, 0]}}\n" for i in range(2001))
    assert "more than 2,000 in cloud" in refusal(tmp_path, "cloud:\n" + many)
    rows = "from,to,length\n" + "P,Q,2\n" * 20_001
    (tmp_path / "d.csv").write_text(rows)
    assert "20,001 distances; at most 20,000" in refusal(tmp_path, "unit: m\ndistances: d.csv\n")


# --- anything at all

KEYS = st.sampled_from(
    "crs unit height points distances cloud images scale_bars lat lon easting northing accuracy "
    "elevation elevation_accuracy from to length higher check xyz A B".split()
)
WORDS = st.one_of(
    st.sampled_from(["A", "B", "EPSG:4326", "EPSG:32611", "m", "ft", "true", "nan", "1,5", "."]),
    st.integers(-200, 4_000_000),
    st.floats(),
    st.booleans(),
    st.none(),
    st.text(max_size=8),
)
TREES = st.recursive(
    WORDS,
    lambda inner: st.lists(inner, max_size=4)
    | st.dictionaries(st.one_of(KEYS, st.text(max_size=4)), inner, max_size=5),
    max_leaves=25,
)


def reads_or_refuses(path: Path) -> None:
    try:
        found = read_control(path)
    except ControlError as error:
        message = str(error)
        assert len(message.splitlines()) == 1
        assert message.isprintable()
        return
    for point in found.points.values():
        assert (point.x is None) == (point.y is None)
        assert point.x is None or (math.isfinite(point.x) and found.crs is not None)
    known = {*found.points, *found.cloud}
    assert all({length.start, length.end} <= known for length in found.lengths)
    assert all(length.length_m > 0 for length in found.lengths)
    assert all(len(warning.splitlines()) == 1 for warning in found.warnings)


@given(tree=st.dictionaries(KEYS, TREES, max_size=6), name=st.sampled_from(["c.json", "c.yaml"]))
def test_any_tree_is_read_or_refused(tree, name, tmp_path_factory) -> None:
    path = tmp_path_factory.getbasetemp() / name
    path.write_text(json.dumps(tree), encoding="utf-8")
    reads_or_refuses(path)


@pytest.mark.one_python
@given(
    form=st.sampled_from([(EXAMPLE, "m.yaml"), (as_json(), "m.json"), (GCP_LIST, "m.txt")]),
    cuts=st.lists(
        st.tuples(st.floats(0, 1), st.integers(0, 12), st.text(max_size=6)), min_size=1, max_size=3
    ),
)
def test_any_mutation_is_read_or_refused(form, cuts, tmp_path_factory) -> None:
    text, name = form
    for share, length, put in cuts:
        at = int(share * len(text))
        text = text[:at] + put + text[at + length :]
    path = tmp_path_factory.getbasetemp() / name
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    reads_or_refuses(path)


@given(data=st.binary(max_size=300), ending=st.sampled_from([".yaml", ".json", ".txt", ".csv", ""]))
def test_any_bytes_are_read_or_refused(data, ending, tmp_path_factory) -> None:
    path = tmp_path_factory.getbasetemp() / f"bytes{ending}"
    path.write_bytes(data)
    reads_or_refuses(path)
