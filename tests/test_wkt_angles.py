"""Angles of WKT: degrees, where a file gives them in something that is no angle."""

from __future__ import annotations

import re

import pyproj
import pytest

from quantify_client.crs.wkt import statement_of_wkt

UTM = pyproj.CRS("EPSG:32615").to_wkt("WKT1_GDAL")
COMPOUND = f'COMPD_CS["Projected",{UTM},VERT_CS["local",VERT_DATUM["none",1],UNIT["metres",1]]]'
OWN = re.compile(r'UNIT\["degree",[^,]*(,AUTHORITY\[[^]]*\])?\]')


@pytest.mark.parametrize("unit", ['UNIT["metres",1.00000000]', 'UNIT [ "Foot", 0.3048 ]'])
@pytest.mark.parametrize("wkt", [UTM, COMPOUND])
def test_angles_in_a_unit_of_length_are_degrees(wkt: str, unit: str) -> None:
    """-93 "metres" of longitude would be radians, and the grid half as long as the ground."""
    wrong = OWN.sub(unit, wkt)
    assert wrong != wkt
    stated = statement_of_wkt(wrong, "record")
    crs = pyproj.CRS(stated.crs)
    plane = crs.sub_crs_list[0] if crs.is_compound else crs
    assert pyproj.Proj(plane.to_wkt()).get_factors(-93, 42).meridional_scale == pytest.approx(
        0.9996
    )
    assert "is not an angle: read as degrees" in stated.warnings[0]


@pytest.mark.parametrize("unit", ['UNIT["radian",1]', 'UNIT["grad",0.0157079632679]'])
def test_other_angles_are_left_as_they_are(unit: str) -> None:
    wkt = OWN.sub(unit, pyproj.CRS("EPSG:4326").to_wkt("WKT1_GDAL"))
    stated = statement_of_wkt(wkt, "record")
    assert (stated.crs, stated.warnings) == (wkt, ())
