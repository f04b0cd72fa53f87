"""OpenDroneMap's gcp_list.txt: what it says, what is wrong with it, and the way out again."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from quantify_client.crs import positions_to
from quantify_client.errors import ControlError, OutputError
from quantify_client.scaler.control.gcp_write import write_gcp_list
from quantify_client.scaler.control.model import ControlPoint, Pick
from quantify_client.scaler.control.read import read_control

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

COPR = Path(__file__).resolve().parents[3] / "shared/data/copr_gcps"
NEEDS_COPR = pytest.mark.skipif(
    not COPR.exists(), reason=f"the survey is not there: {COPR} (it lies outside the repository)"
)
UTM = "EPSG:32611\n"
ROW = "235281.01 3811195.14 12.5 730.5 1019.9 IMG_0031.jpg"


def listed(folder: Path, text: str):
    (folder / "gcp_list.txt").write_text(text, encoding="utf-8")
    return read_control(folder / "gcp_list.txt")


# --- in


@pytest.mark.parametrize(
    "header",
    [
        "EPSG:32611",
        "WGS84 UTM 11N",
        "+proj=utm +zone=11 +ellps=WGS84 +datum=WGS84 +units=m +no_defs\t",
        "\ufeffEPSG:32611  ",
        "# surveyed by hand\n\nEPSG:32611",
    ],
)
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_header_and_rows(header: str, end: str, tmp_path: Path) -> None:
    rows = [f"{ROW} A", "", "# a comment", f"  {ROW.replace('0031', '0032')}\tA  more columns "]
    found = listed(tmp_path, end.join([header.replace("\n", end), *rows]))
    assert found.crs == "EPSG:32611"
    assert found.points == {"A": ControlPoint("A", 235281.01, 3811195.14, elevation_m=12.5)}
    assert found.picks == (
        Pick("A", "IMG_0031.jpg", 730.5, 1019.9),
        Pick("A", "IMG_0032.jpg", 730.5, 1019.9),
    )
    assert (found.lengths, found.cloud, found.height_m, found.warnings) == ((), {}, None, ())


def test_front_door_reads_the_same(tmp_path: Path) -> None:
    found = listed(tmp_path, UTM + ROW)
    (tmp_path / "no-ending").write_text(UTM + ROW)
    assert vars(read_control(tmp_path / "gcp_list.txt")) == vars(found)
    assert read_control(tmp_path / "no-ending").points == found.points


def test_rows_without_names_are_told_apart_by_coordinates(tmp_path: Path) -> None:
    rows = ["5 6 7 1 1 a.jpg", "8 9 7 2 2 a.jpg", "5.0 6.00 7 3 3 b.jpg", "8 9 7 4 4 b.jpg A"]
    found = listed(tmp_path, "EPSG:4326\n" + "\n".join(rows))
    assert [pick.name for pick in found.picks] == ["gcp-1", "A", "gcp-1", "A"]
    assert list(found.points) == ["gcp-1", "A"]


def test_made_names_avoid_real_ones(tmp_path: Path) -> None:
    found = listed(tmp_path, "EPSG:4326\n5 6 7 1 1 a.jpg\n8 9 7 2 2 a.jpg gcp-1")
    assert [pick.name for pick in found.picks] == ["gcp-2", "gcp-1"]


@pytest.mark.parametrize(
    ("heights", "elevations", "warning"),
    [
        (["0", "0.0"], [None, None], "all 2 elevations are 0: taken as unknown"),
        (["0", "nan"], [None, None], "all 2 elevations are 0 or nan: taken as unknown"),
        (["nan", "NaN"], [None, None], "all 2 elevations are nan: taken as unknown"),
        (["12.5", "nan"], [12.5, None], "1 of 2 elevations are nan and taken as unknown (p1)"),
        (["12.5", "0"], [12.5, 0.0], "p1 at elevation 0 among others"),
        (["-0.5", "12"], [-0.5, 12.0], None),
    ],
)
def test_heights(heights, elevations, warning, tmp_path: Path) -> None:
    rows = [f"{i} 5 {z} 1 1 {i}.jpg p{i}" for i, z in enumerate(heights)]
    found = listed(tmp_path, "EPSG:4326\n" + "\n".join(rows))
    assert [point.elevation_m for point in found.points.values()] == elevations
    assert (warning is None) == (found.warnings == ())
    assert warning is None or (len(found.warnings) == 1 and warning in found.warnings[0])
    assert ("relative control" in str(found.warnings)) == (elevations == [None, None])


def test_only_coordinates(tmp_path: Path) -> None:
    found = listed(tmp_path, "EPSG:4326\n-119.8 34.4 5\n-119.9 34.4 6\n")
    assert list(found.points) == ["gcp-1", "gcp-2"]
    found = listed(tmp_path, "EPSG:4326\nA -119.8 34.4 5\nB -119.9 34.4 6\n")
    assert found.points["B"] == ControlPoint("B", -119.9, 34.4, elevation_m=6.0)
    assert found.picks == ()


def test_unknown_positions_are_nan(tmp_path: Path) -> None:
    found = listed(tmp_path, UTM + "nan nan nan 1 1 a.jpg P")
    assert found.points == {"P": ControlPoint("P")}
    assert found.crs is None


def test_same_row_twice_counts_once(tmp_path: Path) -> None:
    found = listed(tmp_path, UTM + f"{ROW} A\n" * 3)
    assert len(found.picks) == 1
    assert found.warnings == ("gcp_list.txt: 2 rows are there twice and count once",)


def test_heights_of_a_list_in_feet_are_metres(tmp_path: Path) -> None:
    found = listed(tmp_path, "EPSG:2229\n6000000 2000000 12.5 1 1 a.jpg A")
    assert found.points["A"] == ControlPoint("A", 6000000.0, 2000000.0, elevation_m=12.5)
    assert "not in metres" in found.warnings[0]


@pytest.mark.parametrize(
    ("text", "fragment"),
    [
        ("# only this\n", "holds only comments"),
        (UTM, "holds a CRS and no rows"),
        ("EPSG:99999\n" + ROW, "line 1: unknown CRS 'EPSG:99999'"),
        ("EPSG:5703\n" + ROW, "or a map projection, such as"),
        ("WGS84 UTM 11\n" + ROW, "line 1: unknown CRS"),
        (ROW, "expected the CRS of the rows before them"),
        ("3483\t729\tIMG_0031.jpg\n", "pixels and photographs without coordinates or names"),
        (UTM + "3483 729 IMG_0031.jpg", "line 2: '3483 729 IMG_0031.jpg' has neither"),
        (UTM + "IMG_0031.jpg -119 34 12", "geo.txt"),
        (UTM + "1 2 3 4", "has 4 columns"),
        (UTM + "235281,3811195,12,1,1,a.jpg", "separate them by blanks"),
        (UTM + "235281, 3811195, 12, 1, 1, a.jpg", "x is '235281,'"),
        (UTM + ROW + "\n235281 3811195 12", "line 3: 3 columns, and rows above have another form"),
        (UTM + ROW.replace("12.5", "12,5"), "z is '12,5': a decimal comma; write 12.5"),
        (UTM + ROW.replace("12.5", "high"), "z is 'high': expected a number"),
        (UTM + ROW.replace("12.5", "inf"), "z is 'inf'"),
        (UTM + ROW.replace("12.5", "1e12"), "absurdly large"),
        (UTM + ROW.replace(".jpg", "\x07.jpg"), "no name of a photograph"),
        (UTM + ROW.replace("12.5", "99999"), "no height on the Earth"),
        (UTM + ROW.replace("730.5", "nan"), "px is 'nan'"),
        (UTM + ROW.replace("730.5", "-3"), "pixel -3, 1019.9 is in no photograph"),
        (UTM + ROW.replace("3811195.14", "nan"), "x or y alone is nan"),
        (UTM + "nan nan nan 1 1 a.jpg", "neither coordinates nor a name"),
        (UTM + "-119.8 34.4 0 1 1 a.jpg", "looks like degrees"),
        ("EPSG:4326\n34.4 -119.8 0 1 1 a.jpg", "lat -119.8 and lon 34.4 seem to be swapped"),
        ("EPSG:4326\n0 0 0 1 1 a.jpg", "in the sea"),
        ("EPSG:4326\n235281 3811195 0 1 1 a.jpg", "lat is 3811195: expected -90 to 90"),
        (UTM + f"{ROW} A\n{ROW.replace('12.5', '12.6')} A", "line 3: 'A' has other coordinates"),
        (UTM + f"{ROW} A\n{ROW} B", "line 3: 'B' has the coordinates of 'A'"),
        (UTM + f"{ROW} A\n{ROW.replace('730.5', '9')} A", "another pixel of 'IMG_0031.jpg'"),
        (UTM + f"{ROW} " + "x" * 101, "a name may have 100 characters"),
        (UTM + f"{ROW} a\x07b", "control characters"),
        pytest.param(
            UTM + "\n".join(f"{i} 9999 5" for i in range(1000, 3002)),
            "more than 2,000 points",
            id="points",
        ),
        pytest.param(UTM + "1000 9999 5\n" * 100_001, "more than 100,000 rows", id="rows"),
    ],
)
def test_mistake_is_named_in_one_line(text: str, fragment: str, tmp_path: Path) -> None:
    with pytest.raises(ControlError) as caught:
        listed(tmp_path, text)
    message = str(caught.value)
    assert fragment in message
    assert message.isprintable()
    assert message.startswith("gcp_list.txt")
    assert len(message) < 500


@NEEDS_COPR
def test_real_list_is_relative_control() -> None:
    found = read_control(COPR / "gcp_list.txt")
    assert sorted(found.points) == [f"gcp{n:02d}" for n in range(10)]
    assert all(point.elevation_m is None for point in found.points.values())
    assert found.crs == "EPSG:32611"
    assert found.warnings == (
        "gcp_list.txt: all 10 elevations are 0: taken as unknown, so this is relative control",
    )
    counts = [sum(pick.name == name for pick in found.picks) for name in sorted(found.points)]
    assert counts == [1, 2, 3, 3, 3, 3, 3, 3, 3, 3]


@NEEDS_COPR
def test_real_list_of_coordinates_has_the_same_places() -> None:
    found = read_control(COPR / "gcp_list_noimg.txt")
    assert list(found.points) == [f"gcp{n:02d}" for n in range(1, 11)]
    averages = read_control(COPR / "GPS_average.txt")
    for number in range(1, 11):
        point, average = found.points[f"gcp{number:02d}"], averages.points[f"cop-target{number}"]
        assert (point.x, point.y) == (average.x, average.y)


@NEEDS_COPR
def test_real_list_without_coordinates_is_refused() -> None:
    with pytest.raises(ControlError, match="without coordinates or names fix nothing"):
        read_control(COPR / "gcp_list_nocoord.txt")


# --- out

PLACES = {"A": (235281.0123, 3811195.1449, 12.5), "B 2": (235277.61, 3811190.36, 0.0)}
PICKS = [
    Pick("A", "a.jpg", 730.476818, 1019.5),
    Pick("B 2", "a.jpg", 1, 2),
    Pick("A", "b.jpg", 3, 4),
]


def test_what_is_written(tmp_path: Path) -> None:
    left_out = write_gcp_list(tmp_path / "gcp_list.txt", "EPSG:32611", PLACES, PICKS)
    assert (tmp_path / "gcp_list.txt").read_bytes().decode() == (
        "EPSG:32611\n"
        "# quantify-client\n"
        "235281.0123 3811195.1449 12.5000 730.476818 1019.5 a.jpg A\n"
        "235277.6100 3811190.3600 0.0000 1.0 2.0 a.jpg B_2\n"
        "235281.0123 3811195.1449 12.5000 3.0 4.0 b.jpg A\n"
    )
    assert left_out == []
    assert [file.name for file in tmp_path.iterdir()] == ["gcp_list.txt"]


def test_left_out_are_named(tmp_path: Path) -> None:
    places = {**PLACES, "C": (235279.0, 3811195.0, math.nan)}
    picks = [*PICKS, Pick("D", "a.jpg", 1, 1), Pick("D", "b.jpg", 1, 1)]
    assert write_gcp_list(tmp_path / "g.txt", "EPSG:32611", places, picks) == ["C", "D"]


@pytest.mark.parametrize(
    ("crs", "header"),
    [
        ("EPSG:32611", "EPSG:32611"),
        ("WGS84 UTM 11N", "EPSG:32611"),
        ("EPSG:32611+5773", "EPSG:32611"),
        ("+proj=utm +zone=11 +datum=WGS84 +units=m", "EPSG:32611"),
        (
            "+proj=tmerc +lat_0=34 +lon_0=-119 +k=1 +x_0=400000 +y_0=0 +ellps=GRS80 +units=m",
            "+proj=tmerc +lat_0=34 +lon_0=-119 +k=1 +x_0=400000 +y_0=0 +ellps=GRS80 +units=m "
            "+no_defs",
        ),
    ],
)
def test_header_is_one_that_opendronemap_reads(crs: str, header: str, tmp_path: Path) -> None:
    write_gcp_list(tmp_path / "g.txt", crs, PLACES, PICKS)
    assert (tmp_path / "g.txt").read_text().splitlines()[0] == header


NAMES = st.text("abcXYZ019-_äß", min_size=1, max_size=8)
POINTS = st.dictionaries(
    NAMES,
    st.tuples(st.floats(-120, -119), st.floats(34, 35), st.floats(1, 4000)),
    min_size=1,
    max_size=6,
)


@given(points=POINTS, pixels=st.lists(st.floats(0, 6000), min_size=2, max_size=2))
@pytest.mark.parametrize(("crs", "step"), [("EPSG:4326", 1e-9), ("EPSG:32611", 1e-3)])
def test_written_list_reads_back(crs, step, points, pixels, tmp_path_factory) -> None:
    path = tmp_path_factory.getbasetemp() / "round.txt"
    picks = [Pick(n, f"{i}.jpg", px, px / 2) for n in points for i, px in enumerate(pixels)]
    lon, lat, height = np.array(list(points.values())).T
    east, north = positions_to(lon, lat, "EPSG:4326", crs)
    places = dict(zip(points, zip(east.tolist(), north.tolist(), height.tolist())))
    assume(len({tuple(np.round(place, 3)) for place in places.values()}) == len(places))
    assert write_gcp_list(path, crs, places, picks) == []
    found = read_control(path)
    assert found.crs == crs
    assert list(found.points) == list(points)
    assert found.picks == tuple(picks)
    for name, (x, y, z) in places.items():
        point = found.points[name]
        assert (point.x, point.y) == pytest.approx((x, y), abs=step, rel=0)
        assert point.elevation_m == pytest.approx(z, abs=1e-3)


@pytest.mark.parametrize(
    ("crs", "places", "picks", "fragment"),
    [
        ("EPSG:32611", {}, PICKS, "no point has both coordinates and picks"),
        ("EPSG:32611", PLACES, [], "no point has both coordinates and picks"),
        ("EPSG:32611", {"A": (1e5, 4e6, math.nan)}, PICKS, "'A' has no finite coordinates"),
        ("EPSG:32611", {"A": (math.inf, 4e6, 1)}, PICKS, "'A' has no finite coordinates"),
        ("EPSG:32611", {"A": (1e5, 4e6, 0)}, PICKS, "height of every point is 0"),
        (
            "EPSG:32611",
            {"A": (1e5, 4e6, 1), "B 2": (1e5, 4e6 + 1e-6, 1)},
            PICKS,
            "'A' and 'B 2' have the same coordinates",
        ),
        (
            "EPSG:32611",
            {"B_2": (1e5, 4e6, 1), "B 2": (1e5, 5e6, 1)},
            [*PICKS, Pick("B_2", "a.jpg", 1, 1)],
            "would both be written 'B_2'",
        ),
        ("EPSG:32611", PLACES, [Pick("A", "a b.jpg", 1, 1)], "has blanks in its name"),
        ("EPSG:32611", PLACES, [Pick("A", "", 1, 1)], "has blanks in its name"),
        ("EPSG:32611", PLACES, [Pick("A", "a.jpg", math.nan, 1)], "has no pixel"),
        ("EPSG:4978", PLACES, PICKS, "or a map projection, such as"),
        ("nonsense", PLACES, PICKS, "unknown CRS"),
    ],
)
def test_what_opendronemap_would_misread_is_not_written(
    crs, places, picks, fragment, tmp_path: Path
) -> None:
    with pytest.raises(ControlError) as caught:
        write_gcp_list(tmp_path / "gcp_list.txt", crs, places, picks)
    assert fragment in str(caught.value)
    assert str(caught.value).isprintable()
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "folder", tmp_path / "nowhere" / "g.txt", tmp_path / ("x" * 300)):
        with pytest.raises(OutputError) as caught:
            write_gcp_list(path, "EPSG:32611", PLACES, PICKS)
        assert str(caught.value).isprintable()
    assert [file.name for file in tmp_path.iterdir()] == ["folder"]
    assert list((tmp_path / "folder").iterdir()) == []


def test_list_that_was_there_is_replaced_or_kept(tmp_path: Path) -> None:
    path = tmp_path / "gcp_list.txt"
    write_gcp_list(path, "EPSG:32615", PLACES, PICKS)
    before = path.read_text()
    with pytest.raises(ControlError):
        write_gcp_list(path, "EPSG:32611", {"A": (1e5, 4e6, 0)}, PICKS)
    assert path.read_text() == before
    write_gcp_list(path, "EPSG:32611", PLACES, PICKS)
    assert path.read_text().startswith("EPSG:32611\n")
