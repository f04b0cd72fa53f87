"""What said each part of a cloud's CRS, and what said otherwise, is told wherever it counts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Dict, Mapping

import numpy as np
import pytest
from clouds import write_ept
from stated import IOWA, MISSISSIPPI, US_FT, circle, geokeys, las

from quantify_client import describe
from quantify_client.crs.statements import Statement, merge_statements


def parts(found: Mapping[str, Any]) -> Dict[str, Any]:
    return {part["part"]: (part["value"], part["source"]) for part in found["coordinates"]}


KEYS = {1024: 1, 3072: 26995, 3076: 9003, 4096: 5703, 4099: 9003}


def test_each_part_of_a_crs_has_its_key(tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", MISSISSIPPI, (US_FT, US_FT), geokeys(KEYS))
    found = describe(path)
    foot = "US survey foot"
    said = parts(found)
    assert said.pop("projection")[1] == "GeoTIFF key 3072"
    assert said == {
        "CRS": ("NAD83 / Mississippi West (US survey foot)", "GeoTIFF key 3072"),
        "datum": ("North American Datum 1983", "GeoTIFF key 3072"),
        "horizontal unit": (foot, "GeoTIFF key 3076"),
        "vertical unit": (foot, "GeoTIFF key 4099"),
    }
    contrary = {part["part"]: part["contradicted_by"] for part in found["coordinates"]}
    assert contrary["horizontal unit"] == [{"value": "metre", "source": "GeoTIFF key 3072"}]
    assert contrary["vertical unit"] == [{"value": "metre", "source": "GeoTIFF key 4096"}]
    assert contrary["datum"] == []


def test_metres_of_heights_that_a_crs_does_not_show_are_said(tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", IOWA, (1, 1), geokeys({1024: 1, 3072: 26915, 4099: 9001}))
    assert parts(describe(path))["vertical unit"] == ("metre", "GeoTIFF key 4099")


def test_a_projection_spelled_out_has_its_keys(tmp_path: Path) -> None:
    keys = {1024: 1, 2048: 4326, 3072: 32767, 3074: 16015, 3076: 9001, 4099: 9003}
    found = parts(describe(las(tmp_path / "a.las", IOWA, (1.0, US_FT), geokeys(keys))))
    assert found["datum"][1] == "GeoTIFF key 2048"
    assert found["projection"] == ("UTM zone 15N", "GeoTIFF key 3074")
    assert found["horizontal unit"] == ("metre", "GeoTIFF key 3076")


@pytest.mark.parametrize(
    ("options", "part", "said"),
    [
        ({"vertical_unit": "cm"}, "vertical unit", ("cm", "--vertical-unit")),
        (
            {"crs": "EPSG:6344"},
            "datum",
            ("NAD83 (National Spatial Reference System 2011)", "--crs"),
        ),
        ({}, "vertical unit", ("metre", "nothing says it: assumed")),
    ],
)
def test_what_the_user_gave_is_said(
    options: Dict[str, str], part: str, said: Any, tmp_path: Path
) -> None:
    path = las(tmp_path / "a.las", IOWA, (1.0, 1.0), geokeys({1024: 1, 3072: 26915}))
    assert parts(describe(path, **options))[part] == said


def test_units_alone_are_said_too(tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", (0.0, 0.0), (1.0, 1.0), [])
    assert parts(describe(path)) == {}
    said = ("ft", "--source-unit")
    assert parts(describe(path, source_unit="ft")) == {
        "horizontal unit": said,
        "vertical unit": said,
    }
    found = parts(describe(path, source_unit="ft", vertical_unit="m"))
    assert found == {"horizontal unit": said, "vertical unit": ("m", "--vertical-unit")}


@pytest.mark.parametrize("name", ["a.prj", "a.las.aux.xml"])
def test_a_file_beside_the_cloud_is_named(name: str, tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", IOWA, (1.0, 1.0), [])
    text = "EPSG:26915"
    (tmp_path / name).write_text(f"<SRS>{text}</SRS>" if name.endswith("xml") else text)
    assert parts(describe(path))["CRS"] == ("NAD83 / UTM zone 15N", name)


def test_ept_names_its_member(tmp_path: Path) -> None:
    srs = {"authority": "EPSG", "horizontal": "26915", "vertical": "6360"}
    points = np.column_stack([*np.add.outer(IOWA, np.arange(9.0)), np.arange(9.0)])
    found = parts(describe(write_ept(tmp_path / "ept", points, srs=srs)))
    assert found["CRS"][1] == "ept.json srs.horizontal"
    assert found["heights"] == ("NAVD88 height (ftUS)", "ept.json srs.vertical")
    assert found["vertical unit"] == ("US survey foot", "ept.json srs.vertical")


def test_what_contradicts_a_record_stays_known() -> None:
    stated = merge_statements(
        [
            Statement("WKT", "EPSG:26915+5703"),
            Statement("keys", "EPSG:26995", ("US survey foot", US_FT), "EPSG:6360"),
        ]
    )
    found = {part.part: part.contradicted_by for part in stated.parts}
    assert found["projection"][0][1] == found["horizontal unit"][0][1] == "keys"
    assert found["horizontal unit"][0][0] == found["vertical unit"][0][0] == "US survey foot"
    assert any("metre, and NAD83 / Mississippi West" in text for text in stated.warnings)


def test_a_unit_alone_beside_a_crs_is_told() -> None:
    alone = Statement("keys", None, ("foot", 0.3048))
    stated = merge_statements([Statement("WKT", "EPSG:26915"), alone])
    assert stated.warnings == (
        "WKT and keys contradict each other: metre and foot; the first is used "
        "(--crs sets another)",
    )


def test_reports_say_what_was_taken_from_where(tmp_path: Path, run: Any) -> None:
    path = las(tmp_path / "a.las", MISSISSIPPI, (US_FT, US_FT), geokeys(KEYS))
    area = tmp_path / "area.geojson"
    area.write_text(json.dumps(circle(MISSISSIPPI, US_FT)))
    status, out, _ = run("volume", path, "--area", area, "--base", "plane", "--out", tmp_path / "o")
    assert status == 0
    said = "(GeoTIFF key 3076; not metre, as GeoTIFF key 3072 says)"
    assert f"horizontal unit US survey foot {said}" in " ".join(out.split())
    page = (tmp_path / "o" / "report.html").read_text()
    assert said in page
    provenance = page[page.index("Provenance") :].lower()
    assert provenance.count(">crs<") == 1
    document = json.loads((tmp_path / "o" / "report.json").read_text())
    assert parts(document["provenance"])["horizontal unit"][1] == "GeoTIFF key 3076"
    status, out, _ = run("info", path)
    assert f"horizontal unit US survey foot {said}" in " ".join(out.split())
