"""The same CRS in other words is the same; another one is not."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Tuple

import pyproj
import pytest
from stated import IOWA, geokeys, las, wkt_record

from quantify_client import describe
from quantify_client.crs.same import differences, same_coordinates
from quantify_client.crs.statements import Statement, merge_statements
from quantify_client.errors import CloudError

_NULL = "+proj=utm +zone=15 +datum=WGS84 +towgs84=0,0,0,0,0,0,0 +units=m +no_defs +type=crs"
_MOVED = _NULL.replace("=0,0,0,", "=100,0,0,")


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("EPSG:32615", "EPSG:32615+5703", True),  # heights in metres, as without
        ("EPSG:32615", "EPSG:32615+6360", False),  # in feet
        ("EPSG:2277", "EPSG:2277+6360", True),  # in feet, as x and y
        ("EPSG:2277", "EPSG:2277+5703", False),
        ("EPSG:32615", "EPSG:32615+5715", False),  # depths
        ("EPSG:32615", "EPSG:32616", False),
        ("EPSG:26915", pyproj.CRS(26915).to_wkt("WKT1_ESRI"), True),
        (_NULL.replace("+towgs84=0,0,0,0,0,0,0 ", ""), _NULL, True),
        (_NULL, _MOVED, False),
        ("EPSG:32615", "nonsense", False),
    ],
)
def test_tiles_of_one_survey_have_the_same_coordinates(one: str, other: str, same: bool) -> None:
    assert same_coordinates(one, other) is same
    assert same_coordinates(other, one) is same


def _without_authority(text: str) -> str:
    return re.sub(r',(AUTHORITY|ID)\["EPSG","?\d+"?\]', "", text)


@pytest.mark.parametrize("dialect", ["WKT1_GDAL", "WKT1_ESRI", "WKT2_2015", "WKT2_2019"])
@pytest.mark.parametrize("code", [26915, 2277, 27700, 2193, 2056, 3857, 3035, 28992, 4326])
def test_a_crs_in_other_words_is_the_same(code: int, dialect: str) -> None:
    text = pyproj.CRS(code).to_wkt(dialect)
    for spelled in (text, _without_authority(text)):
        assert same_coordinates(spelled, f"EPSG:{code}")
        assert not merge_statements(
            [Statement("one", spelled), Statement("two", f"EPSG:{code}")]
        ).warnings


@pytest.mark.parametrize(
    ("one", "other", "parts"),
    [
        (26915, 6344, ("datum",)),
        (32632, 25832, ("datum",)),
        (26915, 26916, ("projection",)),
        (2255, 26995, ("horizontal unit",)),
        (5514, 5513, ("projection",)),
        (2277, 6588, ("datum", "projection")),
    ],
)
def test_different_crs_differ_in_their_parts(one: int, other: int, parts: Tuple[str]) -> None:
    assert differences(pyproj.CRS(one), pyproj.CRS(other)) == parts


def test_parameters_rounded_to_less_than_a_millimetre_are_the_same() -> None:
    exact = pyproj.CRS(2277).to_wkt("WKT1_GDAL")
    rounded = exact.replace("30.1166666666667", "30.1166667").replace("3333333", "333333")
    assert rounded != exact
    assert same_coordinates(rounded, "EPSG:2277")
    assert not same_coordinates(exact.replace("30.1166666666667", "30.2"), "EPSG:2277")


def test_site_grids_have_nothing_but_their_names() -> None:
    grids = [f'LOCAL_CS["{name}",UNIT["metre",1]]' for name in ("mine A", "mine B")]
    assert not same_coordinates(*grids)
    assert same_coordinates(grids[0], grids[0].replace('"metre"', '"Meter"'))


def test_a_crs_that_names_no_datum_contradicts_none() -> None:
    bare = "+proj=utm +zone=15 +ellps=GRS80 +units=m +type=crs"
    assert (
        merge_statements([Statement("WKT", "EPSG:26915"), Statement("proj.txt", bare)]).warnings
        == ()
    )
    assert (
        merge_statements([Statement("WKT", "EPSG:26916"), Statement("proj.txt", bare)]).warnings
        != ()
    )


def test_tiles_in_other_words_are_one_survey(tmp_path: Path) -> None:
    esri = pyproj.CRS(26915).to_wkt("WKT1_ESRI")
    one = las(tmp_path / "a.las", IOWA, (1, 1), geokeys({1024: 1, 3072: 26915, 4099: 9001}))
    other = las(tmp_path / "b.las", IOWA, (1, 1), [wkt_record(esri)], "1.4")
    assert describe(one, other)["crs"] == "EPSG:26915"
    third = las(tmp_path / "c.las", IOWA, (1, 1), geokeys({1024: 1, 3072: 26916}))
    with pytest.raises(CloudError, match=r"EPSG:26916.*EPSG:26915"):
        describe(one, third)


def test_a_crs_that_is_given_goes_before_those_of_all_tiles(tmp_path: Path) -> None:
    one = las(tmp_path / "a.las", IOWA, (1, 1), geokeys({1024: 1, 3072: 26915}))
    other = las(tmp_path / "b.las", IOWA, (1, 1), geokeys({1024: 1, 3072: 6344}))
    with pytest.raises(CloudError, match=r"another datum; expected tiles of one survey.*--crs"):
        describe(one, other)
    found = describe(one, other, crs="EPSG:26915")
    assert found["crs"] == "EPSG:26915"
    assert any("both are taken to be in that of --crs" in text for text in found["warnings"])


def test_files_beside_tiles_may_spell_one_crs_in_two_ways(tmp_path: Path) -> None:
    tiles = [las(tmp_path / f"{name}.las", IOWA, (1, 1), []) for name in "ab"]
    tiles[0].with_suffix(".prj").write_text("EPSG:26915")
    tiles[1].with_suffix(".prj").write_text(pyproj.CRS(26915).to_wkt("WKT1_ESRI"))
    assert describe(*tiles)["crs"] == "EPSG:26915"
    tiles[1].with_suffix(".prj").write_text("EPSG:26916")
    with pytest.raises(CloudError, match=r"a\.prj 'EPSG:26915' and b\.prj 'EPSG:26916'.*--crs"):
        describe(*tiles)
