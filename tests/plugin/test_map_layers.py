"""Map layers: the picture lies where the cells are, the outlines enclose what the slices say."""

import base64
import json
import math
import zlib
from dataclasses import replace

import numpy as np
import pytest
import shapely
import shapely.affinity
from beach import frame_of

from quantify_client import measure
from quantify_client.report.document.geojson import to_geojson
from quantify_client.types import AreaFailure, Slice
from quantify_client.webmap import layers
from quantify_client.webmap.contours import contour
from quantify_client.webmap.layers import indexed_png, map_layers, on_map


def pixels(png):
    """Return the indices of a PNG of ours, and its palette's alpha."""
    chunks, at = {}, 8
    while at < len(png):
        size = int.from_bytes(png[at : at + 4], "big")
        chunks[png[at + 4 : at + 8]] = png[at + 8 : at + 8 + size]
        at += size + 12
    columns, rows = (int.from_bytes(chunks[b"IHDR"][i : i + 4], "big") for i in (0, 4))
    lines = np.frombuffer(zlib.decompress(chunks[b"IDAT"]), np.uint8).reshape(rows, columns + 1)
    return lines[:, 1:], chunks[b"tRNS"]


def test_png_is_one():
    indices = np.array([[0, 1, 2], [2, 1, 0]], dtype=np.uint8)
    png = indexed_png(indices, [(0, 0, 0, 0), (255, 0, 0, 200), (0, 0, 255, 255)])
    image = pytest.importorskip("PIL.Image")
    import io

    opened = image.open(io.BytesIO(png)).convert("RGBA")
    assert opened.size == (3, 2)
    assert opened.getpixel((1, 0)) == (255, 0, 0, 200)
    assert opened.getpixel((2, 0)) == (0, 0, 255, 255)
    found, alpha = pixels(png)
    assert found.tolist() == indices.tolist()
    assert alpha == b"\x00\xc8\xff"


def test_contour_of_a_cone_is_a_circle():
    y, x = np.mgrid[0:101, 0:121]
    heights = 40.0 - np.hypot(x - 60, y - 50)
    (ring,) = contour(heights, 10.0)
    assert ring.is_ring
    assert shapely.Polygon(ring).area == pytest.approx(math.pi * 30.0**2, rel=2e-3)
    assert shapely.Polygon(ring).centroid.coords[0] == pytest.approx((60.0, 50.0), abs=1e-9)


def test_contour_ends_where_nothing_is_known():
    heights = np.tile(np.arange(10.0), (5, 1))
    heights[2, :] = np.nan
    lines = contour(heights, 4.25)
    assert len(lines) == 2
    assert all(np.allclose(np.asarray(line.coords)[:, 0], 4.25) for line in lines)
    assert contour(heights, 99.0) == []
    assert contour(heights[:1], 4.25) == []


def test_contours_of_noise_are_closed_or_end_at_the_edge():
    heights = np.random.default_rng(3).normal(size=(30, 40))
    for line in contour(heights, 0.0):
        for x, y in (line.coords[0], line.coords[-1]):
            assert line.is_ring or x in (0.0, 39.0) or y in (0.0, 29.0)


def test_places_on_the_map_and_back():
    plane = on_map(frame_of("EPSG:32615"), 576_700.0, 5_188_150.0, 160.0)
    x, y = np.array([576_661.9, 576_768.2]), np.array([5_188_114.1, 5_188_211.7])
    lon, lat = plane.lon_lat(x, y)
    assert lon == pytest.approx([-91.99458, -91.99317], abs=1e-5)
    back = plane.places(lon, lat)
    assert np.allclose(back, (x, y), atol=1e-6)
    assert on_map(frame_of(None), 0.0, 0.0, 0.0) is None


@pytest.fixture(scope="module")
def cone(site):
    return measure(site / "pile.laz", area=str(site / "pile.geojson"), slices=8)


def test_picture_of_a_cone_is_round_and_where_the_cone_is(cone):
    (layer,) = map_layers(cone)
    indices, alpha = pixels(base64.b64decode(layer["relief"]["png"]))
    rows, columns = np.nonzero(indices >= 200)  # the upper part
    assert len(rows) > 100
    (south, west), (north, east) = layer["relief"]["bounds"]
    lon = west + (columns.mean() + 0.5) / indices.shape[1] * (east - west)
    lat = north - (rows.mean() + 0.5) / indices.shape[0] * (north - south)
    relief = cone.results[0].relief
    plane = on_map(cone.frame, relief.min_x, relief.min_y, 0.0)
    x, y = plane.places(np.array([lon]), np.array([lat]))
    top = shapely.from_wkb(relief.polygon_wkb).centroid
    assert math.hypot(x[0] - top.x, y[0] - top.y) < relief.cell_m
    assert alpha[0] == 0
    assert indices[0, 0] == 0
    assert layer["relief"]["max_m"] == pytest.approx(cone.results[0].max_height_m, rel=0.05)


def test_outlines_of_a_cone_enclose_the_areas_of_its_slices(cone):
    (layer,) = map_layers(cone)
    features = layer["outlines"]["features"]
    assert len(features) >= 6
    for feature in features[1:-1]:
        told = feature["properties"]
        (line,) = feature["geometry"]["coordinates"]
        plane = on_map(cone.frame, cone.results[0].relief.min_x, cone.results[0].relief.min_y, 0.0)
        x, y = plane.places(*np.array(line).T)
        area = math.pi * (8.0 - 2.0 * told["z_m"]) ** 2  # a cone of radius 8 m and height 4 m
        assert shapely.Polygon(np.column_stack([x, y])).area == pytest.approx(area, rel=0.06)


def test_body_has_outlines_and_a_cloud_without_crs_no_layers(site):
    without = measure(site / "body.xyz")
    (layer,) = map_layers(without)
    assert layer["relief"] is None
    assert layer["outlines"]["features"] == []


def test_failure_has_an_empty_layer(cone):
    from dataclasses import replace

    failed = replace(cone, results=[AreaFailure("a", "b")])
    (layer,) = map_layers(failed)
    assert layer == {
        "name": "a",
        "relief": None,
        "outlines": {"type": "FeatureCollection", "features": []},
        "proposal": None,
    }


@pytest.fixture(scope="module")
def inside(site):
    """The cone of radius 8 m, with an outline of 6.5 m."""
    outline = shapely.from_geojson((site / "pile.geojson").read_text())
    polygon = shapely.get_parts(outline)[0]
    shrunk = shapely.affinity.scale(polygon, 6.5 / 9, 6.5 / 9)
    return measure(site / "pile.laz", area=json.loads(shapely.to_geojson(shrunk)))


def test_the_proposed_outline_is_on_the_map_beyond_the_toe(inside):
    (layer,) = map_layers(inside)
    (feature,) = layer["proposal"]["features"]
    plane = on_map(inside.frame, inside.results[0].relief.min_x, inside.results[0].relief.min_y, 0)
    x, y = plane.places(*np.array(feature["geometry"]["coordinates"][0]).T)
    middle = shapely.from_wkb(inside.results[0].relief.polygon_wkb).centroid
    away = np.hypot(x - middle.x, y - middle.y)
    assert away.min() > 7.9
    assert away.max() < 10.0


def test_the_proposed_outline_is_a_feature_of_its_own(inside):
    drawn, proposed = to_geojson(inside)["features"]
    assert proposed["properties"] == {"name": "area-1 (proposed)", "proposed": True}
    drawn, proposed = (shapely.geometry.shape(one["geometry"]) for one in (drawn, proposed))
    assert proposed.contains(drawn)
    assert proposed.area == pytest.approx(drawn.area * (8.8 / 6.5) ** 2, rel=0.15)


def test_piles_that_were_found_are_on_the_map_in_their_order(site):
    found = measure(site / "pile.laz", area="auto")
    (feature,) = layers.measured_proposals(found)["features"]
    (one,) = found.proposals
    assert feature["properties"] == {
        "name": found.results[0].name,
        "proposed": True,
        "kind": "pile",
        "height_m": one.height_m,
        "outline_std_m3": one.outline_std_m3,
    }
    plane = on_map(found.frame, found.results[0].relief.min_x, found.results[0].relief.min_y, 0)
    x, y = plane.places(*np.array(feature["geometry"]["coordinates"][0]).T)
    assert shapely.Polygon(np.column_stack([x, y])).area == pytest.approx(math.pi * 8.4**2, rel=0.1)
    assert layers.measured_proposals(replace(found, proposals=())) is None


def test_outlines_of_a_forest_come_to_an_end(cone, monkeypatch):
    """Small rings everywhere: no tolerance makes them fewer, so the shortest are left out."""
    monkeypatch.setattr(layers, "MOST_VERTICES", 2000)
    monkeypatch.setattr(layers, "MOST_LINES", 500)
    y, x = np.mgrid[0:200, 0:200]
    heights = np.sin(0.6 * x) * np.sin(0.6 * y) * (1.0 + x / 200.0)
    relief = replace(cone.results[0].relief, above_base_m=heights, fraction=np.ones(heights.shape))
    slices = tuple(Slice(z, 0.1, 1.0, 0.1, 5) for z in np.arange(-1.9, 2.0, 0.2))
    result = replace(cone.results[0], relief=relief, slices=slices)
    (layer,) = map_layers(replace(cone, results=(result,)))
    features = layer["outlines"]["features"]
    count = sum(len(line) for each in features for line in each["geometry"]["coordinates"])
    assert layers.MOST_VERTICES / 4 < count <= layers.MOST_VERTICES
    assert len(features) > len(slices) / 2
