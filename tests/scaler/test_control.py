"""Control files: what each form says."""

from __future__ import annotations

from pathlib import Path

import pytest
from controls import EXAMPLE, as_json, control, refusal

from quantify_client.scaler.control.model import CloudPosition, ControlPoint, Length, Pick
from quantify_client.scaler.control.read import read_control

COPR = Path(__file__).resolve().parents[3] / "shared/data/copr_gcps"
NEEDS_COPR = pytest.mark.skipif(
    not COPR.exists(), reason=f"the survey is not there: {COPR} (it lies outside the repository)"
)


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
