"""Control files: what each form says, and one line for every mistake."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from quantify_client.errors import ControlError
from quantify_client.scaler.control import read_control
from quantify_client.scaler.nouns import CloudPosition, ControlPoint, Length, Pick

COPR = Path(__file__).resolve().parents[3] / "shared/data/copr_gcps"
NEEDS_COPR = pytest.mark.skipif(
    not COPR.exists(), reason=f"the survey is not there: {COPR} (it lies outside the repository)"
)

EXAMPLE = """\
crs: EPSG:4326
unit: m
height: 12
points:
  A: {lat: 34.40829882, lon: -119.87999210, accuracy: 3.0}
  B: {lat: 34.40834272, lon: -119.87995661, accuracy: 3.0, elevation: 12.4,
      elevation_accuracy: 0.02}
distances:
  - {from: A, to: B, length: 5.879, accuracy: 0.005, higher: B}
  - {from: A, to: P, length: 41.20, accuracy: 0.01, check: true}
cloud:
  A: {xyz: [235281.02, 3811195.11, 11.93], accuracy: 0.02}
  P: {xyz: [235270.10, 3811201.50, 11.20]}
  Q: {xyz: [235272.02, 3811201.95, 11.31]}
scale_bars:
  - {from: P, to: Q, length: 2.000, accuracy: 0.001}
"""
GCP_LIST = "EPSG:32611\n235281.01 3811195.14 12.5 730.5 1019.9 IMG_0031.jpg B\n"


def control(folder: Path, text: str, name: str = "control.yaml"):
    (folder / name).write_text(text, encoding="utf-8")
    return read_control(folder / name)


def refusal(folder: Path, text: str, name: str = "control.yaml") -> str:
    with pytest.raises(ControlError) as caught:
        control(folder, text, name)
    return one_line(caught.value)


def one_line(error: ControlError) -> str:
    message = str(error)
    assert len(message.splitlines()) == 1
    assert message.isprintable()
    assert 20 <= len(message) <= 500
    return message


# --- what a control file says


def test_example_of_the_format(tmp_path: Path) -> None:
    found = control(tmp_path, EXAMPLE)
    assert found.label == str(tmp_path / "control.yaml")
    assert (found.crs, found.height_m, found.warnings) == ("EPSG:4326", 12.0, ())
    assert found.points == {
        "A": ControlPoint("A", -119.8799921, 34.40829882, 3.0),
        "B": ControlPoint("B", -119.87995661, 34.40834272, 3.0, 12.4, 0.02),
    }
    assert found.lengths == (
        Length("A", "B", 5.879, 0.005, higher="B"),
        Length("A", "P", 41.2, 0.01, check=True),
        Length("P", "Q", 2.0, 0.001, bar=True),
    )
    assert found.cloud["A"] == CloudPosition("A", (235281.02, 3811195.11, 11.93), 0.02)
    assert list(found.cloud) == ["A", "P", "Q"]
    assert found.picks == ()


def as_json() -> str:
    return json.dumps(
        {
            "crs": "EPSG:4326",
            "unit": "m",
            "height": 12,
            "points": {
                "A": {"lat": 34.40829882, "lon": "-119.87999210", "accuracy": 3.0},
                "B": {
                    **{"lat": 34.40834272, "lon": -119.87995661, "accuracy": 3},
                    **{"elevation": 12.4, "elevation_accuracy": 2e-2},
                },
            },
            "distances": [
                {"from": "A", "to": "B", "length": 5.879, "accuracy": 0.005, "higher": "B"},
                {"from": "A", "to": "P", "length": 41.2, "accuracy": 0.01, "check": True},
            ],
            "cloud": {
                "A": {"xyz": [235281.02, 3811195.11, 11.93], "accuracy": 0.02},
                "P": {"xyz": [235270.1, 3811201.5, 11.2], "accuracy": None},
                "Q": {"xyz": [235272.02, 3811201.95, "11.31"]},
            },
            "images": None,
            "scale_bars": [{"from": "P", "to": "Q", "length": 2.0, "accuracy": 0.001}],
        }
    )


def said(found):
    """All of a control but its label."""
    return {key: value for key, value in vars(found).items() if key != "label"}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("control.json", as_json()),
        ("control.YML", EXAMPLE),
        ("control", EXAMPLE),
        ("json-without-ending", as_json()),
        ("control.yaml", "\ufeff" + EXAMPLE.replace("\n", "\r\n")),
        ("json-is-yaml.yaml", as_json()),
    ],
)
def test_same_control_in_other_forms(name: str, text: str, tmp_path: Path) -> None:
    assert said(control(tmp_path, text, name)) == said(control(tmp_path, EXAMPLE))


def test_utf_16_with_its_mark_is_read(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_bytes(EXAMPLE.encode("utf-16"))
    assert said(read_control(tmp_path / "c.yaml")) == said(control(tmp_path, EXAMPLE))


@pytest.mark.parametrize(("unit", "metres"), [("m", 1), ("ft", 0.3048), ("us-ft", 1200 / 3937)])
def test_lengths_become_metres_and_coordinates_do_not(unit, metres, tmp_path: Path) -> None:
    found = control(
        tmp_path,
        f"""{{crs: EPSG:2229, unit: {unit}, height: 40, points: {{A: {{easting: 6000000.5,
        northing: 2000000.25, accuracy: 10, elevation: 20, elevation_accuracy: 1}}}},
        distances: [{{from: A, to: B, length: 30, accuracy: 0.1}}],
        cloud: {{B: {{xyz: [1, 2, 3], accuracy: 0.5}}}}}}""",
    )
    point = found.points["A"]
    assert (point.x, point.y) == (6000000.5, 2000000.25)
    assert point.accuracy_m == 10 * metres
    assert (point.elevation_m, point.elevation_accuracy_m) == (20 * metres, metres)
    assert (found.lengths[0].length_m, found.lengths[0].accuracy_m) == (30 * metres, 0.1 * metres)
    assert found.height_m == 40 * metres
    assert found.cloud["B"] == CloudPosition("B", (1, 2, 3), 0.5)


def test_unit_is_not_needed_without_lengths(tmp_path: Path) -> None:
    found = control(tmp_path, "points: {A: {lat: 1, lon: 2}}\ncloud: {A: {xyz: [1, 2, 3]}}")
    assert found.points == {"A": ControlPoint("A", 2.0, 1.0)}
    assert found.crs == "EPSG:4326"
    assert found.warnings == (
        "control.yaml: no crs is given; lat and lon are taken as WGS84 (EPSG:4326)",
    )


def test_crs_is_none_where_no_point_has_a_position(tmp_path: Path) -> None:
    found = control(tmp_path, "{crs: EPSG:32611, unit: m, points: {A: {elevation: 5}}}")
    assert found.crs is None
    assert found.points == {"A": ControlPoint("A", elevation_m=5.0)}


@pytest.mark.parametrize(
    ("crs", "code"),
    [
        ("WGS84 UTM 11N", "EPSG:32611"),
        ("+proj=utm +zone=11 +datum=WGS84 +units=m", "EPSG:32611"),
        ("EPSG:6340+5703", "EPSG:6340"),
        ("32611", "EPSG:32611"),
    ],
)
def test_crs_in_words_gets_its_code(crs: str, code: str, tmp_path: Path) -> None:
    text = f"crs: {crs}\npoints: {{A: {{easting: 235281, northing: 3811195}}}}"
    assert control(tmp_path, text).crs == code


NAMES = ["1", "007", "NO", "yes", "null", "~", "2024-01-01", "1e3", "12:30", "0x10", "Höhe 3", "<<"]


@pytest.mark.parametrize("name", NAMES)
def test_names_stay_what_the_user_wrote(name: str, tmp_path: Path) -> None:
    other = f"'{name}'"  # in quotes, since nothing is what null means as a value
    found = control(
        tmp_path,
        f"unit: m\npoints:\n  {name}: {{lat: 1, lon: 2}}\n  Z: {{lat: 1, lon: 2}}\n"
        f"distances:\n  - from: {other}\n    to: Z\n    length: 3\n    higher: {other}\n",
    )
    assert list(found.points) == [name, "Z"]
    assert found.lengths == (Length(name, "Z", 3.0, higher=name),)


def test_names_are_stripped_and_of_one_spelling(tmp_path: Path) -> None:
    text = '{unit: m, cloud: {" Ho\\u0308he ": {xyz: [1, 2, 3]}, B: {xyz: [2, 2, 3]}}, '
    text += '"scale_bars": [{from: "H\\u00f6he", to: B, length: 1}]}'
    found = control(tmp_path, text)
    assert list(found.cloud) == ["H\u00f6he", "B"]


@pytest.mark.parametrize(
    ("text", "value"),
    [("1e-3", 0.001), ("+.5", 0.5), ("5.", 5.0), ("'7'", 7.0), ("1E1", 10.0), ("010", 10.0)],
)
def test_numbers(text: str, value: float, tmp_path: Path) -> None:
    bar = f"unit: m\ncloud: {{A: {{xyz: [0, 0, 0]}}, B: {{xyz: [{text}, 0, 0]}}}}\n"
    found = control(tmp_path, bar + f"scale_bars: [{{from: A, to: B, length: {text}}}]")
    assert found.lengths[0].length_m == value
    assert found.cloud["B"].xyz == (value, 0, 0)


def test_same_pair_twice_is_two_measurements(tmp_path: Path) -> None:
    twice = "  - {from: A, to: B, length: 5.88}\n"
    found = control(tmp_path, EXAMPLE.replace("distances:\n", "distances:\n" + twice))
    assert [(length.start, length.end) for length in found.lengths[:2]] == [("A", "B")] * 2


def test_accuracy_as_large_as_the_length_is_said(tmp_path: Path) -> None:
    found = control(tmp_path, EXAMPLE.replace("accuracy: 0.005", "accuracy: 5.9"))
    assert any("A-B" in warning and "as large" in warning for warning in found.warnings)


# --- pictures


def test_images_add_points_and_picks(tmp_path: Path) -> None:
    (tmp_path / "gcp_list.txt").write_text(
        "EPSG:32611\n235277.61 3811190.36 12.5 1 2 a.jpg C\n235281.01 3811195.14 13.0 3 4 a.jpg B\n"
    )
    found = control(tmp_path, EXAMPLE + "images: gcp_list.txt\n")
    assert list(found.points) == ["A", "B", "C"]
    assert found.points["B"] == control(tmp_path, EXAMPLE).points["B"]  # the control file wins
    added = found.points["C"]
    # the same place by the survey's own GPS_average.txt, rounded to centimetres in between
    assert (added.x, added.y) == pytest.approx((-119.879992097, 34.4082988202), abs=1e-7)
    assert (added.elevation_m, added.accuracy_m) == (12.5, None)
    assert found.picks == (Pick("C", "a.jpg", 1, 2), Pick("B", "a.jpg", 3, 4))


def test_picks_without_names_find_their_points_by_place(tmp_path: Path) -> None:
    (tmp_path / "g.txt").write_text(
        "EPSG:32611\n"
        "235281.01 3811195.14 0 1 1 a.jpg\n"  # B
        "235290.00 3811195.14 0 2 2 a.jpg\n"  # nobody
        "235277.61 3811190.36 0 3 3 b.jpg\n"  # A
        "235281.01 3811195.14 0 4 4 b.jpg\n"  # B again
        "235299.00 3811195.14 0 5 5 a.jpg\n"  # nobody
    )
    found = control(tmp_path, EXAMPLE + "images: g.txt\n")
    assert [pick.name for pick in found.picks] == ["B", "gcp-1", "A", "B", "gcp-2"]
    assert list(found.points) == ["A", "B", "gcp-1", "gcp-2"]


def test_half_a_metre_decides(tmp_path: Path) -> None:
    points = "crs: EPSG:32611\npoints: {A: {easting: 500000, northing: 4000000}}\nimages: g.txt\n"
    for offset, name in ((0.45, "A"), (0.55, "gcp-1")):
        row = f"{500000 + offset} 4000000 7 1 1 a.jpg"
        (tmp_path / "g.txt").write_text("EPSG:32611\n" + row)
        assert control(tmp_path, points).picks[0].name == name


def test_two_points_within_reach_are_nobodys(tmp_path: Path) -> None:
    points = "crs: EPSG:32611\nimages: g.txt\npoints: {A: {easting: 500000, northing: 4000000}, "
    points += "B: {easting: 500000.3, northing: 4000000}}"
    (tmp_path / "g.txt").write_text("EPSG:32611\n500000.1 4000000 7 1 1 a.jpg")
    assert control(tmp_path, points).picks[0].name == "gcp-1"


def test_two_nameless_points_near_one_are_refused(tmp_path: Path) -> None:
    (tmp_path / "g.txt").write_text(
        "EPSG:32611\n500000.1 4000000 7 1 1 a.jpg\n500000.2 4000000 7 1 1 b.jpg"
    )
    text = "crs: EPSG:32611\npoints: {A: {easting: 500000, northing: 4000000}}\nimages: g.txt\n"
    assert "within 0.5 m of 'A', as line 2 is" in refusal(tmp_path, text)


def test_points_of_images_count_too(tmp_path: Path) -> None:
    rows = [f"nan nan nan 1 1 a.jpg q{i}" for i in range(1000)]
    (tmp_path / "g.txt").write_text("EPSG:32611\n" + "\n".join(rows))
    (tmp_path / "p.csv").write_text("name,lat,lon\n" + "".join(f"p{i},1,2\n" for i in range(1001)))
    text = "crs: EPSG:4326\npoints: p.csv\nimages: g.txt\n"
    assert "more than 2,000 points with those of images" in refusal(tmp_path, text)


def test_scale_bar_between_picks_needs_no_gps(tmp_path: Path) -> None:
    rows = [f"nan nan nan {i} {i} {i}.jpg {name}" for i in range(3) for name in "PQ"]
    (tmp_path / "g.txt").write_text("EPSG:32611\n" + "\n".join(rows))
    found = control(tmp_path, "{unit: m, images: g.txt, scale_bars: [{from: P, to: Q, length: 2}]}")
    assert found.points == {"P": ControlPoint("P"), "Q": ControlPoint("Q")}
    assert found.crs is None
    assert len(found.picks) == 6


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
    ("crs: EPSG:5703\n", "Vertical CRS"),
    ("crs: EPSG:4978\n", "Geocentric CRS"),
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
    start = time.monotonic()
    assert "anchors" in refusal(tmp_path, "\n".join(lines))
    assert time.monotonic() - start < 1.0


def test_deep_yaml_is_refused_at_once(tmp_path: Path) -> None:
    start = time.monotonic()
    assert "nested too deeply" in refusal(tmp_path, "points: " + "[" * 500_000)
    assert time.monotonic() - start < 2.0


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


# --- a real survey


@NEEDS_COPR
def test_real_averages_name_the_places_of_the_real_list(tmp_path: Path) -> None:
    found = control(tmp_path, f"points: {COPR}/GPS_average.txt\nimages: {COPR}/gcp_list.txt\n")
    assert len(found.points) == 20  # cop-target1 ... and gcp00 ..., which are the same places
    nameless = "\n".join(
        " ".join(line.split()[:6]) if number else line
        for number, line in enumerate((COPR / "gcp_list.txt").read_text().splitlines())
    )
    (tmp_path / "nameless.txt").write_text(nameless)
    found = control(tmp_path, f"points: {COPR}/GPS_average.txt\nimages: nameless.txt\n")
    assert len(found.points) == 10
    assert {pick.name for pick in found.picks} == set(found.points)
    assert len(found.picks) == 27
