"""CRSs and units as real files spell them: what each comes to, in its frame.

Records of LAS files of many programs, by the facts that their makers' trackers tell: WKT 1 and 2,
ESRI's words, codes left out, heights in every way, GeoTIFF keys complete and not.
"""

from __future__ import annotations

import re
from typing import Any, Dict, Mapping, Optional, Sequence, Tuple

import pyproj
import pytest
from stated import FT, US_FT

from quantify_client.crs import measuring_frame, statement_of_wkt
from quantify_client.crs.geokeys import statement_of_geokeys
from quantify_client.crs.statements import MergedStatements, Statement, merge_statements
from quantify_client.errors import CrsError
from quantify_client.types import Bounds

pytestmark = pytest.mark.one_python

IN_DEGREES = Bounds(7.44, 46.95, 0.0, 7.45, 46.96, 10.0)
ESRI_FOOT = (
    ',VERTCS["NAVD88_height_(ftUS)",VDATUM["North_American_Vertical_Datum_1988"],'
    'PARAMETER["Vertical_Shift",0.0],PARAMETER["Direction",1.0],UNIT["US survey foot",'
    "0.304800609601219]]"
)
GEOID = 'VERT_CS["{}",VERT_DATUM["{}",2005],UNIT["{}",{}],AXIS["Gravity-related height",UP]]'
BARE = "bare"  # a plane with a unit and no place


def wkt(crs: Any, dialect: str = "WKT1_GDAL") -> str:
    return str(pyproj.CRS(crs).to_wkt(dialect))


def anonymous(text: str) -> str:
    return re.sub(r',(AUTHORITY|ID)\["EPSG","?\d+"?\]', "", text)


def compound(crs: int, name: str, unit: str = "US survey foot", metres: float = US_FT) -> str:
    heights = GEOID.format(name, name, unit, metres)
    return f'COMPD_CS["unknown",{wkt(crs)},{heights}]'


def keys(
    numbers: Mapping[int, float], texts: Optional[Mapping[int, str]] = None
) -> Tuple[Statement]:
    return (statement_of_geokeys({1024: 1, **numbers}, texts or {}),)


def record(text: str) -> Tuple[Statement]:
    return (statement_of_wkt(text, "LAS WKT record"),)


# Statements; the frame's CRS; metres of a unit of x and y, and of z.
SPELLINGS: Dict[str, Tuple[Sequence[Statement], Optional[str], float, float]] = {
    "New Zealand, GDAL, north first": (record(wkt(2193)), "EPSG:2193", 1, 1),
    "New Zealand, ESRI": (record(wkt(2193, "WKT1_ESRI")), "EPSG:2193", 1, 1),
    "New Zealand, 2019": (record(wkt(2193, "WKT2_2019")), "EPSG:2193", 1, 1),
    "Poland, north first, no codes": (record(anonymous(wkt(2180))), "EPSG:2180", 1, 1),
    "Switzerland + LN02": (record(wkt("EPSG:2056+5728", "WKT2_2015")), "EPSG:2056", 1, 1),
    "Switzerland, ESRI": (record(wkt(2056, "WKT1_ESRI")), "EPSG:2056", 1, 1),
    "Krovak, ESRI": (record(wkt(5514, "WKT1_ESRI")), "EPSG:5514", 1, 1),
    "Krovak + Baltic": (record(wkt("EPSG:5514+8357", "WKT2_2019")), "EPSG:5514", 1, 1),
    "Krovak, south and west": (keys({3072: 5513}), "EPSG:5513", 1, 1),
    "Britain + ODN": (record(wkt("EPSG:27700+5701")), "EPSG:27700", 1, 1),
    "Britain + ODN, keys": (keys({3072: 27700, 4096: 5701, 4099: 9001}), "EPSG:27700", 1, 1),
    "UTM + feet": (record(wkt("EPSG:26917+6360")), "EPSG:26917", 1, US_FT),
    "UTM + feet, keys": (keys({3072: 26917, 4096: 6360}), "EPSG:26917", 1, US_FT),
    "degrees with heights": (record(wkt(4979, "WKT2_2019")), "EPSG:32632", 1, 1),
    "degrees, international feet": (
        *(keys({1024: 2, 2048: 4326, 2054: 9102, 4099: 9002}), "EPSG:32632", 1, FT),
    ),
    "both codes, as laspy was asked about": (
        *(keys({2048: 4326, 2050: 6326, 3072: 32612, 3076: 9001, 4099: 9001}), "EPSG:32612", 1, 1),
    ),
    "web Mercator with PROJ's text": (record(wkt(3857)), "EPSG:3857", 1, 1),
    "web Mercator, ESRI's code": (record(wkt("ESRI:102100", "WKT1_ESRI")), "EPSG:3857", 1, 1),
    "South Africa": (record(wkt(2048, "WKT2_2019")), "EPSG:2048", 1, 1),
    "Arizona, international feet": (keys({3072: 2223, 3076: 9002}), "EPSG:2223", FT, FT),
    "Texas, ESRI, PROJCS and VERTCS": (
        *(record(wkt(2277, "WKT1_ESRI") + ESRI_FOOT), "EPSG:2277", US_FT, US_FT),
    ),
    "UTM, ESRI, with heights in feet": (
        *(record(wkt(26915, "WKT1_ESRI") + ESRI_FOOT), "EPSG:26915", 1, US_FT),
    ),
    "geoid in the place of heights": (
        *(record(compound(3455, "Geoid 2012A")), "EPSG:3455", US_FT, US_FT),
    ),
    "geoid of another year": (
        *(record(compound(6430, "NAVD88 - Geoid18 (ftUS)")), "EPSG:6430", US_FT, US_FT),
    ),
    "heights without a name": (record(compound(32632, "", "metre", 1.0)), "EPSG:32632", 1, 1),
    "heights without a name in feet": (
        *(record(compound(32632, "", "foot", FT)), "EPSG:32632", 1, FT),
    ),
    "heights unknown": (record(compound(32641, "unknown", "metre", 1.0)), "EPSG:32641", 1, 1),
    "Netherlands, one code for both": (keys({3072: 7415}), "EPSG:28992", 1, 1),
    "junk behind the WKT": (record(wkt(26915) + "\n\0\0xyz"), "EPSG:26915", 1, 1),
    "PROJ text as a record": (record("+proj=utm +zone=15 +datum=NAD83"), "EPSG:26915", 1, 1),
    "garbage beside keys": ((*record("garbage"), *keys({3072: 26915})), "EPSG:26915", 1, 1),
    "its name alone": (keys({3072: 32767}, {3073: "NAD83 / UTM zone 15N"}), "EPSG:26915", 1, 1),
    "a site's name alone": (keys({3072: 32767, 3076: 9003}, {3073: "Iowa"}), None, US_FT, US_FT),
    "UTM by its projection": (keys({2048: 4326, 3072: 32767, 3074: 16031}), "EPSG:32631", 1, 1),
    "size of a foot": (
        *(keys({2048: 4269, 3072: 32767, 3074: 15359, 3076: 32767, 3077: US_FT}), "EPSG:2277"),
        *(US_FT, US_FT),
    ),
    "from Rome": (keys({3072: 26591}), "EPSG:26591", 1, 1),
    "site grid": (
        record(
            'ENGCRS["Site",EDATUM["Site"],CS[Cartesian,2],AXIS["x",east],AXIS["y",'
            'north],LENGTHUNIT["metre",1]]'
        ),
        None,
        1,
        1,
    ),
    "site grid in feet": (record('LOCAL_CS["Site",UNIT["foot",0.3048]]'), None, FT, FT),
    "TOWGS84": (
        record(
            'PROJCS["OSGB",GEOGCS["OSGB36",DATUM["OSGB36",SPHEROID["Airy 1830",6377563.396,'
            "299.3249646],TOWGS84[446.448,-125.157,542.06,0.15,0.247,0.842,-20.489]],"
            'PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION['
            '"Transverse_Mercator"],PARAMETER["latitude_of_origin",49],PARAMETER['
            '"central_meridian",-2],PARAMETER["scale_factor",0.9996012717],PARAMETER['
            '"false_easting",400000],PARAMETER["false_northing",-100000],UNIT["metre",1]]'
        ),
        *("EPSG:27700", 1, 1),
    ),
    "depths": (record(wkt("EPSG:32631+5715", "WKT2_2019")), "EPSG:32631", 1, -1),
    "polar": (record(wkt(3413)), "EPSG:3413", 1, 1),
}


def frame_of(statements: Sequence[Statement]) -> Tuple[Any, MergedStatements]:
    stated = merge_statements(statements)
    return measuring_frame(stated.crs, None, IN_DEGREES), stated


@pytest.mark.parametrize("name", SPELLINGS)
def test_spellings_come_to_their_crs_and_units(name: str) -> None:
    statements, crs, unit, height = SPELLINGS[name]
    frame, stated = frame_of(statements)
    assert (frame.crs, frame.unit_m) == (crs, pytest.approx(unit, rel=1e-12))
    assert frame.z_unit_m == pytest.approx(height, rel=1e-7)
    assert {part.part for part in stated.parts} >= {"horizontal unit", "vertical unit"}


@pytest.mark.parametrize(
    "statements",
    [
        record(wkt(4978, "WKT2_2019")),
        keys({1024: 3, 2048: 4978}),
        keys({1024: 3, 2048: 4326, 3076: 9001}),
    ],
)
def test_coordinates_from_the_middle_of_the_earth_are_refused(statements: Any) -> None:
    with pytest.raises(CrsError, match=r"is a Geocentric CRS, which has no map plane.*\(--crs\)"):
        frame_of(statements)


def test_what_is_not_known_is_told() -> None:
    stated = merge_statements(keys({3072: 65000}))
    assert stated.crs is None
    assert "EPSG:65000 is not known here" in stated.warnings[0]
    stated = merge_statements(keys({4096: 6360, 4099: 9003}))
    assert stated.crs is None
    assert (
        "heights are in US survey foot, and nothing says the unit of x and y"
        in (stated.warnings[-1])
    )
    assert "--source-unit and --vertical-unit" in stated.warnings[-1]


def test_a_name_that_is_only_like_one_of_epsg_is_none() -> None:
    assert merge_statements(keys({3072: 32767}, {3073: "NAD83 / UTM zone"})).crs is None
    assert merge_statements(keys({3072: 32767}, {3073: "NAD83"})).crs is None
    assert merge_statements(keys({3072: 32767}, {3073: "EPSG:26915"})).crs is None


def test_only_one_of_two_contradictions_is_told_where_the_other_is_not_believed() -> None:
    beside = keys({3072: 26995, 3076: 9003})
    stated = merge_statements([*record(wkt(26995)), *beside])
    (warning,) = stated.warnings
    assert "contradict each other" in warning
