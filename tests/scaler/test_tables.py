"""CSV files of points, distances and cloud positions."""

from __future__ import annotations

from pathlib import Path

import pytest

from quantify_client.errors import ControlError
from quantify_client.scaler.control.model import CloudPosition, ControlPoint, Length
from quantify_client.scaler.control.read import read_control

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

COPR = Path(__file__).resolve().parents[3] / "shared/data/copr_gcps"
NEEDS_COPR = pytest.mark.skipif(
    not COPR.exists(), reason=f"the survey is not there: {COPR} (it lies outside the repository)"
)
CLOUD = "cloud: {A: {xyz: [0, 0, 0]}, B: {xyz: [1, 0, 0]}}\n"


def control(folder: Path, table: str, text: str, encoding: str = "utf-8"):
    (folder / "t.csv").write_bytes(table.encode(encoding))
    (folder / "control.yaml").write_text(text)
    return read_control(folder / "control.yaml")


@pytest.mark.parametrize(
    "table",
    [
        "name,lat,lon\nA,34.4,-119.8\n",
        "Point Name,Latitude,Longitude\r\nA,34.4,-119.8\r\n",
        "LABEL;LNG;LAT\nA;-119.8;34.4",
        "id\tlong\tlatitude\nA\t-119.8\t34.4\n",
        "\ufeffpoint_name, Lat (deg), Lon [deg]\n A , 34.4 , -119.8 \n\n",
        '"point","lat","lon"\n"A","34.4","-119.8"\n,,\n',
        "\n#point,lat,lon,accuracy\nA,34.4,-119.8,\n",
        "lat,lon,name,\n34.4,-119.8,A,\n",
    ],
)
def test_headings_are_forgiving(table: str, tmp_path: Path) -> None:
    found = control(tmp_path, table, "crs: EPSG:4326\npoints: t.csv\n")
    assert found.points == {"A": ControlPoint("A", -119.8, 34.4)}
    assert found.warnings == ()


def test_all_columns_of_points(tmp_path: Path) -> None:
    table = "name;E;N;Elevation (ft);elevation_accuracy;Accuracy\nA;6000000;2000000;10;1;2\n"
    found = control(tmp_path, table, "crs: EPSG:2229\nunit: ft\npoints: t.csv\n")
    assert found.points == {
        "A": ControlPoint("A", 6e6, 2e6, 2 * 0.3048, 10 * 0.3048, 0.3048),
    }


def test_distances(tmp_path: Path) -> None:
    table = "From,To,Distance,accuracy,higher,check\nA,B,1.5,0.01,B,no\nB,A,1.51,,,yes\n"
    found = control(tmp_path, table, f"unit: m\n{CLOUD}distances: t.csv\n")
    assert found.lengths == (
        Length("A", "B", 1.5, 0.01, "B", False),
        Length("B", "A", 1.51, None, None, True),
    )


def test_scale_bars(tmp_path: Path) -> None:
    found = control(tmp_path, "from,to,length\nA,B,2\n", f"unit: m\n{CLOUD}scale_bars: t.csv\n")
    assert found.lengths == (Length("A", "B", 2.0, bar=True),)


def test_cloud(tmp_path: Path) -> None:
    table = "name,x,y,z,accuracy\nA,1,2,3,0.5\nB,4,5,6,\n"
    found = control(tmp_path, table, "cloud: t.csv\n")
    assert found.cloud == {
        "A": CloudPosition("A", (1, 2, 3), 0.5),
        "B": CloudPosition("B", (4, 5, 6)),
    }


def test_path_is_relative_to_the_control_file(tmp_path: Path) -> None:
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "p.csv").write_text("name,lat,lon\nA,34.4,-119.8\n")
    for path in ("tables/p.csv", tmp_path / "tables" / "p.csv", "tables/../tables/p.csv"):
        assert list(control(tmp_path, "", f"points: {path}\n").points) == ["A"]


def test_table_of_points_is_control_by_itself(tmp_path: Path) -> None:
    for name in ("p.csv", "p.txt", "p"):
        (tmp_path / name).write_text("name,lat,lon\nA,34.4,-119.8\n")
        found = read_control(tmp_path / name)
        assert found.points == {"A": ControlPoint("A", -119.8, 34.4)}
        assert found.crs == "EPSG:4326"


def test_table_of_a_spreadsheet_in_utf_16(tmp_path: Path) -> None:
    table = "name\tlat\tlon\nHöhe\t34.4\t-119.8\n"
    assert list(control(tmp_path, table, "points: t.csv\n", "utf-16").points) == ["Höhe"]


def test_columns_that_nothing_is_read_from_are_named(tmp_path: Path) -> None:
    table = "name,id,lat,lon,acuracy,date\nA,7,34.4,-119.8,3,today\n"
    found = control(tmp_path, table, "crs: EPSG:4326\npoints: t.csv\n")
    assert found.points == {"A": ControlPoint("A", -119.8, 34.4)}
    assert found.warnings == (
        "t.csv: nothing is read from the columns 'id', 'acuracy' (did you mean 'accuracy'?), "
        "'date'",
    )


P, D, C = "points: t.csv\n", f"unit: m\n{CLOUD}distances: t.csv\n", "cloud: t.csv\n"


@pytest.mark.parametrize(
    ("table", "text", "fragment"),
    [
        ("", P, "t.csv is empty"),
        ("A,34.4,-119.8\n", P, "no column is headed 'name', the first line is 'A,34.4,-119.8'"),
        ("lat,lon\n34.4,-119.8\n", P, "no column is headed 'name'"),
        ("a,b,length\nA,B,2\n", D, "no column is headed 'from'"),
        ("name,lat,lon,Lat\nA,1,2,3\n", P, "'lat' heads two columns"),
        ("name,lat,lon\nA,34,4,-119,8\n", P, "t.csv: line 2: 5 values under 3 headings"),
        ("name;lat;lon\nA;34,4;-119,8\n", P, "line 2 (A): lon is '-119,8': a decimal comma"),
        ("name,lat,lon\nA,1,2\n\nA,3,4\n", P, "t.csv: line 4 (A): 'A' is there already"),
        ("name,lat,lon\n,1,2\n", P, "line 2: name is missing"),
        ("name,lat,lon\nA,1\n", P, "line 2 (A): lon is missing"),
        ("name,lat,lon\nA,-119.8,34.4\n", P, "seem to be swapped"),
        ("name,lat,lon,accuracy\nA,1,2,3\n", P, "accuracy is 3, but of what unit?"),
        ("name,x,y\nA,1,2\n", P, "there is no crs"),
        ('name,lat,lon\n"A"B,1,2\n', P, "line 2: not valid CSV"),
        ('name,lat,lon\n"A,1,2\n', P, "not valid CSV"),
        ("name,lat,lon\n" + "x" * 200_000 + ",1,2\n", P, "line 2: not valid CSV"),
        ("name,lat,lon\nA\x00,1,2\n", P, "t.csv is binary"),
        ("from,to,length (ft)\nA,B,2\n", D, "length is in ft, and the control file says 'unit: m'"),
        ("from,to,length\nA,B,0\n", D, "t.csv: line 2 (A-B): length is 0"),
        ("from,to,length\nA,Z,1\n", D, "t.csv: line 2 (A-Z): 'Z' is in none of"),
        ("from,to,length\nA,,1\n", D, "line 2: to is missing: expected the name"),
        ("from,to,length,check\nA,B,1,x\n", D, "check is 'x': expected true or false"),
        ("name,x,y\nA,1,2\n", C, "line 2 (A): z is missing; a place in the cloud needs"),
        ("name,x,y,z\nA,1,2,\n", C, "line 2 (A): z is missing"),
        ("name,x,y,z\nA,1,2,z\n", C, "xyz is 'z': expected a number"),
    ],
)
def test_mistake_is_named_in_one_line(table: str, text: str, fragment: str, tmp_path: Path) -> None:
    with pytest.raises(ControlError) as caught:
        control(tmp_path, table, text)
    message = str(caught.value)
    assert fragment in message
    assert message.isprintable()
    assert len(message) < 500


@NEEDS_COPR
def test_real_table_of_averages() -> None:
    found = read_control(COPR / "GPS_average.txt")
    assert len(found.points) == 10
    assert found.points["cop-target1"] == ControlPoint("cop-target1", -119.879992097, 34.4082988202)
    assert found.crs == "EPSG:4326"
