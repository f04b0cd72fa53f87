"""What a file says of its CRS and units in several places is merged, and used.

Each cloud holds a cone of 268.083 true m3 (see `stated`), in units that the file states.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Dict

import numpy as np
import pyproj
import pytest
from clouds import write_ept
from hypothesis import example, given, settings
from hypothesis import strategies as st
from stated import FT, IOWA, MISSISSIPPI, US_FT, cone, geokeys, holds, las, volume, wkt_record

from quantify_client import describe, measure
from quantify_client.crs.geokeys import statement_of_geokeys
from quantify_client.crs.statements import Statement, merge_statements
from quantify_client.errors import CrsError, UsageError

#: Whole commands: what they are made of is tested on the second Python as well.
pytestmark = pytest.mark.one_python

UTM_WKT = pyproj.CRS(26915).to_wkt("WKT1_GDAL")
GEOID = (
    'COMPD_CS["South Dakota South / Geoid 2012A",'
    + pyproj.CRS(3455).to_wkt("WKT1_GDAL")
    + ',VERT_CS["Geoid 2012A",UNIT["US survey foot",0.304800609601219],AXIS["Up",UP]]]'
)
FILES = {
    "metre code, feet as the unit": (
        *(MISSISSIPPI, US_FT, US_FT, "1.2"),
        geokeys({1024: 1, 3072: 26995, 3076: 9003, 4099: 9003}),
    ),
    "WKT without heights, foot of heights in keys": (
        *(IOWA, 1.0, US_FT, "1.4"),
        [*geokeys({1024: 1, 3072: 26915, 3076: 9001, 4096: 6360, 4099: 9003}), wkt_record(UTM_WKT)],
    ),
    "user-defined in feet, heights in metres": (
        *(MISSISSIPPI, US_FT, 1.0, "1.2"),
        geokeys({1024: 1, 2048: 4269, 3072: 32767, 3074: 32767, 3075: 8, 3076: 9003, 4099: 9001}),
    ),
    "UTM spelled out, heights in feet": (
        *(IOWA, 1.0, US_FT, "1.2"),
        geokeys({1024: 1, 2048: 4326, 3072: 32767, 3074: 16015, 3076: 9001, 4099: 9003}),
    ),
    "code in feet, vertical code in metres": (
        *(MISSISSIPPI, US_FT, 1.0, "1.2"),
        geokeys({1024: 1, 3072: 2255, 3076: 9003, 4096: 5703}),
    ),
    "metre code, international foot of heights": (
        *(IOWA, 1.0, FT, "1.2"),
        geokeys({1024: 1, 3072: 26915, 4096: 5103, 4099: 9002}),
    ),
    "compound WKT that PROJ cannot read": (
        *((600_000.0, 150_000.0), US_FT, US_FT, "1.4"),
        [wkt_record(GEOID)],
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_units_are_those_that_the_file_states(name: str, tmp_path: Path) -> None:
    place, unit, height, version, records = FILES[name]
    path = las(tmp_path / "a.las", place, (unit, height), records, version)
    measurement = volume(path, place, unit)
    assert holds(measurement), measurement.results
    assert not any("says nothing about heights" in text for text in measurement.warnings)


def test_a_unit_beside_a_code_is_told(tmp_path: Path) -> None:
    place, unit, height, version, records = FILES["metre code, feet as the unit"]
    path = las(tmp_path / "a.las", place, (unit, height), records, version)
    (warning,) = (text for text in describe(path)["warnings"] if "that unit is used" in text)
    assert "Mississippi West in metre" in warning
    assert "given as US survey foot" in warning


def test_what_can_be_read_of_a_compound_crs_is_told(tmp_path: Path) -> None:
    place, unit, height, version, records = FILES["compound WKT that PROJ cannot read"]
    path = las(tmp_path / "a.las", place, (unit, height), records, version)
    found = describe(path)
    assert found["crs"] == "EPSG:3455"
    assert "US survey foot for heights" in " ".join(found["warnings"])


@pytest.mark.parametrize(
    "srs",
    [
        {"authority": "EPSG", "horizontal": "26915", "vertical": "6360"},
        {"authority": "EPSG", "horizontal": "26915", "vertical": "6360", "wkt": UTM_WKT},
        {"authority": "EPSG", "vertical": "6360", "wkt": UTM_WKT},
    ],
)
def test_heights_of_ept_are_its_vertical_code(srs: Dict[str, str], tmp_path: Path) -> None:
    x, y, z = cone(20_000)
    path = write_ept(
        tmp_path / "ept", np.column_stack([x + IOWA[0], y + IOWA[1], z / US_FT]), srs=srs
    )
    assert holds(volume(path, IOWA))


def test_ept_of_entwine_1_has_its_crs_as_a_text(tmp_path: Path) -> None:
    x, y, z = cone(500)
    path = write_ept(
        tmp_path / "ept", np.column_stack([x + IOWA[0], y + IOWA[1], z]), srs="EPSG:26915"
    )
    assert describe(path)["crs"] == "EPSG:26915"


# Projections spelled out in keys, against PROJ's own definition of the same code, at a place.
SPELLED = {
    "Lambert, two parallels (EPSG:2277, feet)": (
        *(2277, (-98.0, 31.0), {2048: 4269, 3075: 8, 3076: 9003}),
        {
            **{3078: 30 + 7 / 60, 3079: 31 + 53 / 60, 3084: -100 - 1 / 3, 3085: 29 + 2 / 3},
            **{3086: 2_296_583.333, 3087: 9_842_500.0},
        },
    ),
    "Albers (EPSG:5070)": (
        *(5070, (-98.0, 31.0), {2048: 4269, 3075: 11, 3076: 9001}),
        {3078: 29.5, 3079: 45.5, 3080: -96.0, 3081: 23.0, 3082: 0.0, 3083: 0.0},
    ),
    "transverse Mercator (EPSG:27700), datum by its code": (
        *(27700, (-2.5, 54.0), {2048: 32767, 2050: 6277, 3075: 1, 3076: 9001}),
        {3080: -2.0, 3081: 49.0, 3082: 400_000.0, 3083: -100_000.0, 3092: 0.9996012717},
    ),
    "Lambert, one parallel (EPSG:3448)": (
        *(3448, (-77.0, 18.0), {2048: 4758, 3075: 9, 3076: 9001}),
        {3080: -77.0, 3081: 18.0, 3082: 750_000.0, 3083: 650_000.0, 3092: 1.0},
    ),
    "Lambert azimuthal (EPSG:3035)": (
        *(3035, (12.0, 50.0), {2048: 4258, 3075: 10, 3076: 9001}),
        {3088: 10.0, 3089: 52.0, 3082: 4_321_000.0, 3083: 3_210_000.0},
    ),
    "oblique stereographic (EPSG:28992)": (
        *(28992, (5.0, 52.0), {2048: 4289, 3075: 16, 3076: 9001}),
        {
            **{3080: 5 + 23 / 60 + 15.5 / 3600, 3081: 52 + 9 / 60 + 22.178 / 3600},
            **{3082: 155_000.0, 3083: 463_000.0, 3092: 0.9999079},
        },
    ),
    "by the code of the projection (EPSG:2277)": (
        *(2277, (-98.0, 31.0), {2048: 4269, 3074: 15359, 3076: 9003}),
        {},
    ),
    "by its ellipsoid alone (EPSG:32615)": (
        *(32615, (-92.0, 45.0), {3075: 1, 3076: 9001}),
        {
            **{2057: 6_378_137.0, 2059: 298.257223563, 3080: -93.0, 3081: 0.0},
            **{3082: 500_000.0, 3083: 0.0, 3092: 0.9996},
        },
    ),
}


@pytest.mark.parametrize("name", SPELLED)
def test_projections_spelled_out_are_those_of_epsg(name: str) -> None:
    code, place, keys, numbers = SPELLED[name]
    stated = merge_statements([statement_of_geokeys({1024: 1, 3072: 32767, **keys, **numbers}, {})])
    assert stated.crs is not None
    assert stated.warnings == ()
    known = pyproj.CRS(code)
    ours = pyproj.CRS(stated.crs)
    axis = known.axis_info[0]
    assert ours.axis_info[0].unit_conversion_factor == pytest.approx(
        axis.unit_conversion_factor, rel=1e-9
    )
    # On each one's own ellipsoid: what is tested is the projection, not a change of datum.
    expected = pyproj.Transformer.from_crs(known.geodetic_crs, known, always_xy=True)
    found = pyproj.Transformer.from_crs(ours.geodetic_crs, ours, always_xy=True)
    assert found.transform(*place) == pytest.approx(expected.transform(*place), abs=0.002)


def test_wkt_inside_a_citation_is_read() -> None:
    text = "ESRI PE String = " + pyproj.CRS(26915).to_wkt("WKT1_ESRI") + "|"
    stated = merge_statements(
        [statement_of_geokeys({1024: 1, 3072: 32767, 3076: 9001}, {1026: text})]
    )
    assert pyproj.CRS(stated.crs).to_epsg(min_confidence=70) == 26915


@pytest.mark.parametrize("method", [2, 3, 15, 999])
def test_projections_that_are_not_known_keep_their_unit(method: int) -> None:
    stated = merge_statements(
        [statement_of_geokeys({1024: 1, 2048: 4269, 3072: 32767, 3075: method, 3076: 9002}, {})]
    )
    axis = pyproj.CRS(stated.crs).axis_info[0]
    assert axis.unit_conversion_factor == pytest.approx(FT, rel=1e-12)
    assert "only its unit (foot) is used" in stated.warnings[0]


@given(
    st.dictionaries(
        st.sampled_from([1024, 2048, 2050, 2054, 2056, 3072, 3074, 3075, 3076, 4096, 4099]),
        st.one_of(st.integers(0, 65_535), st.sampled_from([32767, 4326, 9001, 9003, 16015, 5703])),
    ),
    st.dictionaries(
        st.integers(2050, 3096), st.floats(allow_nan=False, allow_infinity=False), max_size=8
    ),
)
@example({1024: 0, 3072: 9001, 4096: 5703}, {})  # a frame that has heights of its own
@settings(max_examples=40)
def test_any_keys_lead_to_a_crs_that_is_known_or_to_none(
    keys: Dict[int, int], numbers: Dict[int, float]
) -> None:
    stated = merge_statements([statement_of_geokeys({**numbers, **keys}, {})])
    if stated.crs is not None:
        pyproj.CRS(stated.crs)


def test_the_first_statement_is_used_and_both_are_told() -> None:
    stated = merge_statements(
        [Statement("the record", "EPSG:26915"), Statement("the keys", "EPSG:26916")]
    )
    assert stated.crs == "EPSG:26915"
    assert stated.warnings == (
        "the record and the keys contradict each other: NAD83 / UTM zone 15N in metre, and NAD83 / "
        "UTM zone 16N in metre; the first is used (--crs sets another)",
    )
    stated = merge_statements(
        [
            Statement("the record", "EPSG:2277+6360"),
            Statement("the keys", height_unit=("metre", 1.0)),
        ]
    )
    assert pyproj.CRS(stated.crs).axis_info[2].unit_name == "US survey foot"
    assert "contradict each other on heights: US survey foot and metre" in stated.warnings[0]


def test_two_ways_of_saying_the_same_are_no_contradiction() -> None:
    esri = pyproj.CRS(26915).to_wkt("WKT1_ESRI")
    assert (
        merge_statements([Statement("WKT", esri), Statement("keys", "EPSG:26915")]).warnings == ()
    )


def test_depths_that_only_the_second_statement_has_are_kept() -> None:
    depths = Statement("the codes", "EPSG:32615+5715")  # MSL depth
    assert (
        pyproj.CRS(merge_statements([Statement("WKT", "EPSG:32615"), depths]).crs)
        .axis_info[2]
        .direction
        == "down"
    )


def test_a_crs_that_is_given_goes_before_the_files(tmp_path: Path) -> None:
    wrong = geokeys({1024: 1, 3072: 26995, 4099: 9001})
    path = las(tmp_path / "a.las", MISSISSIPPI, (US_FT, US_FT), wrong)
    measurement = volume(path, MISSISSIPPI, US_FT, crs="EPSG:2255", vertical_unit="us-ft")
    assert holds(measurement)
    assert measurement.crs == "EPSG:2255"
    assert any("--crs and GeoTIFF keys contradict" in text for text in measurement.warnings)
    prj = tmp_path / "true.prj"
    prj.write_text(pyproj.CRS(2255).to_wkt("WKT1_ESRI"))
    assert holds(volume(path, MISSISSIPPI, US_FT, crs=str(prj), vertical_unit="us-ft"))


def test_a_crs_that_is_none_is_refused(tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", IOWA, (1.0, 1.0), [])
    with pytest.raises(CrsError, match="neither a known CRS nor a file"):
        measure(path, crs="EPSG:1")
    (tmp_path / "note.txt").write_text("no CRS at all")
    with pytest.raises(CrsError, match="holds no CRS that is known here"):
        measure(path, crs=str(tmp_path / "note.txt"))


@pytest.mark.parametrize(("unit", "metres"), [("mm", 0.001), ("cm", 0.01), ("us-ft", US_FT)])
def test_units_of_a_cloud_that_does_not_say(unit: str, metres: float, tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", (100.0, 200.0), (metres, metres), [])
    assert holds(volume(path, (100.0, 200.0), metres, source_unit=unit))
    path = las(tmp_path / "b.las", (100.0, 200.0), (1.0, metres), [])
    assert holds(volume(path, (100.0, 200.0), source_unit="m", vertical_unit=unit))


def test_a_unit_of_heights_is_never_lost_in_silence(tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", (100.0, 200.0), (1.0, US_FT), [])
    with pytest.raises(UsageError, match="give --crs or --source-unit, too"):
        measure(path, vertical_unit="us-ft")


@pytest.mark.parametrize("name", ["a.prj", "a.las.aux.xml"])
def test_a_crs_beside_the_cloud_is_read(name: str, tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", IOWA, (1.0, 1.0), [])
    text = pyproj.CRS(26915).to_wkt("WKT1_GDAL")
    if name.endswith("xml"):
        text = f"<PAMDataset><SRS>{text.replace(chr(34), '&quot;')}</SRS></PAMDataset>"
    (tmp_path / name).write_text(text)
    found = describe(path)
    assert (found["crs"], found["crs_origin"]) == ("EPSG:26915", name)


def test_feet_read_as_metres_are_somewhere_else(tmp_path: Path) -> None:
    """State plane of Pennsylvania: 610 km east are 2,000,000 feet, and as metres in the ocean."""
    place = (610_000.0, 100_000.0)
    path = las(tmp_path / "a.las", place, (US_FT, 1.0), geokeys({1024: 1, 3072: 32128}))
    (warning,) = (text for text in describe(path)["warnings"] if "puts the cloud" in text)
    assert "Pennsylvania" in warning
    assert "read as US survey foot its coordinates lie there" in warning
    place = (IOWA[0], IOWA[1])
    path = las(tmp_path / "b.las", place, (1.0, 1.0), geokeys({1024: 1, 3072: 26915}))
    assert not describe(path)["warnings"]


def test_degrees_without_a_crs_are_refused(tmp_path: Path) -> None:
    x, y, z = cone(5000)
    there = pyproj.Transformer.from_crs(32615, 4326, always_xy=True)
    lon, lat = there.transform(x + 576_000, y + 5_188_000)
    np.savetxt(tmp_path / "a.csv", np.column_stack([lon, lat, z]), "%.9f", ",")
    with pytest.raises(CrsError, match=r"look like longitude and latitude; give their CRS \(--crs"):
        measure(tmp_path / "a.csv", shape="terrain")
    made = measure(tmp_path / "a.csv", shape="terrain", crs="EPSG:4326")
    assert made.crs == "EPSG:32615"


@pytest.mark.parametrize("metres", [0.01, 0.001])
def test_heights_in_a_smaller_unit_are_told(metres: float, tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", IOWA, (1.0, metres), geokeys({1024: 1, 3072: 26915}))
    warnings = volume(path, IOWA).warnings
    assert any("--vertical-unit sets their unit" in text for text in warnings)
    assert holds(volume(path, IOWA, vertical_unit={0.01: "cm", 0.001: "mm"}[metres]))


def test_a_file_with_the_crs_is_not_replaced_by_the_report(tmp_path: Path, run: Any) -> None:
    path = las(tmp_path / "a.las", IOWA, (1.0, 1.0), [])
    (tmp_path / "report.json").write_text("EPSG:26915")
    status, _, err = run(
        "volume", path, "--crs", tmp_path / "report.json", "--out", tmp_path, "--base", "plane"
    )
    assert (status, (tmp_path / "report.json").read_text()) == (1, "EPSG:26915")
    assert "report.json" in err


def test_the_options_reach_every_command(tmp_path: Path, run: Any) -> None:
    path = las(tmp_path / "a.las", IOWA, (1.0, 1.0), [])
    status, out, err = run("info", path, "--crs", "EPSG:26915", "--vertical-unit", "ft", "--json")
    assert (status, json.loads(out)["crs"]) == (0, "EPSG:26915")
