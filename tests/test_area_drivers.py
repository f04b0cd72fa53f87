"""Files of polygons that would make a library read other files, or ask a server."""

import json
import os
import sqlite3
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest
import shapely
from beach import BEACH
from drawn import SQUARE, collection, feature, lonlat, only, polygon
from pyogrio import raw

from quantify_client.areas.read import read_areas
from quantify_client.errors import AreaError

# Servers, sizes and words: no different on a second Python.
pytestmark = pytest.mark.one_python

ENDINGS = [".shp", ".gpkg", ".kml", ".dxf", ".fgb"]


@pytest.fixture
def server():
    """Give the address of a server, and what it was asked for."""
    asked = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):  # noqa: N802
            asked.append(self.path)
            self.send_error(404)

        do_HEAD = do_POST = do_GET  # noqa: N815

        def log_message(self, *args):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as httpd:
        thread = threading.Thread(target=httpd.serve_forever, args=(0.05,))
        thread.start()
        yield f"http://127.0.0.1:{httpd.server_port}", asked
        httpd.shutdown()
        thread.join()


@pytest.fixture
def secret(tmp_path, beach):
    """Give a file of polygons that nobody named."""
    folder = tmp_path / "private"
    folder.mkdir()
    path = folder / "secret.geojson"
    path.write_text(json.dumps(collection(feature(polygon(lonlat(beach)), name="Secret"))))
    return path


def vrt(source):
    return (
        f'<OGRVRTDataSource><OGRVRTLayer name="secret"><SrcDataSource>{source}</SrcDataSource>'
        "</OGRVRTLayer></OGRVRTDataSource>"
    )


def wfs(address):
    return f"<OGRWFSDataSource><URL>{address}/wfs?SERVICE=WFS</URL></OGRWFSDataSource>"


def algorithm(source):
    return f'{{"type": "gdal_streamed_alg", "command_line": "gdal vector convert {source}"}}'


def dressed(ending, text):
    """Give a text in the clothes of a format, which it may wear in a comment."""
    if ending == ".kml":
        yield f"<kml><!-- {text.replace('--', '')} --></kml>"
        yield f"<kml>{text}</kml>" if text.startswith("<") else f"<kml><x>{text}</x></kml>"
        yield f'<?xml version="1.0"?>\n{text}'
    elif ending == ".dxf":
        body = "0\nSECTION\n2\nENTITIES\n0\nENDSEC\n0\nEOF\n"
        yield f"999\n{text}\n{body}"
        yield f"0\nSECTION\n999\n{text}\n2\nENTITIES\n0\nENDSEC\n0\nEOF\n"


def refused(path, beach):
    """Tell that nothing is got from a file: an error, or no polygon at all."""
    with pytest.raises(AreaError) as caught:
        read_areas(path, beach, BEACH)
    assert "\n" not in str(caught.value)
    assert "Secret" not in str(caught.value)


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("make", [vrt, algorithm])
def test_a_file_that_names_another_is_not_followed(make, ending, secret, tmp_path, beach):
    path = tmp_path / f"areas{ending}"
    for text in (make(secret), *dressed(ending, make(secret))):
        path.write_text(text)
        refused(path, beach)


@pytest.mark.parametrize("ending", ENDINGS)
def test_no_file_of_polygons_asks_a_server(ending, server, tmp_path, beach):
    address, asked = server
    path = tmp_path / f"areas{ending}"
    for text in (
        vrt(f"/vsicurl/{address}/areas.geojson"),
        vrt(f"{address}/areas.geojson"),
        wfs(address),
        algorithm(f"/vsicurl/{address}/areas.geojson"),
        f'<wfs:FeatureCollection xmlns:wfs="http://www.opengis.net/wfs" xmlns:xsi="http://www.w3.org'
        f'/2001/XMLSchema-instance" xmlns:gml="http://www.opengis.net/gml" xsi:schemaLocation="x '
        f'{address}/s.xsd"></wfs:FeatureCollection>',
    ):
        for content in (text, *dressed(ending, text)):
            path.write_text(content)
            refused(path, beach)
    assert asked == []


@pytest.mark.parametrize(
    "start",
    [
        '<!DOCTYPE kml SYSTEM "{address}/kml.dtd">',
        '<!DOCTYPE kml [<!ENTITY e SYSTEM "{address}/e.txt">]>',
        '<!DOCTYPE kml [<!ENTITY % p SYSTEM "{address}/p.dtd"> %p;]>',
        '<!DOCTYPE kml [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>',
    ],
)
def test_kml_with_a_document_type_is_refused(start, server, tmp_path, beach):
    address, asked = server
    path = tmp_path / "areas.kml"
    path.write_text(start.format(address=address) + "<kml><name>&e;</name></kml>")
    with pytest.raises(AreaError, match="document type"):
        read_areas(path, beach, BEACH)
    assert asked == []


def test_links_and_styles_of_a_kml_are_not_followed(server, tmp_path, beach):
    address, asked = server
    ring = " ".join(f"{x},{y}" for x, y in lonlat(beach))
    path = tmp_path / "areas.kml"
    path.write_text(
        f'<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gml="http://www.opengis.net/gml" '
        f'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:schemaLocation="x {address}/x">'
        f"<Document><NetworkLink><Link><href>{address}/link.kml</href></Link></NetworkLink>"
        f'<Schema id="s"/><Placemark><name>Pile</name><styleUrl>{address}/s.kml#a</styleUrl>'
        f"<Polygon><outerBoundaryIs><LinearRing><coordinates>{ring}</coordinates></LinearRing>"
        "</outerBoundaryIs></Polygon></Placemark></Document></kml>"
    )
    area = only(read_areas(path, beach, BEACH))
    assert area.name == "Pile"
    assert area.polygon.symmetric_difference(shapely.Polygon(SQUARE)).area < 1e-3
    assert asked == []


def test_kml_geometries_are_told_apart(tmp_path, beach):
    ring = lonlat(beach)
    text = " ".join(f"{x}, {y},0" for x, y in ring)  # a blank after the comma is often met
    middle = np.mean(ring[:-1] if ring[0] == ring[-1] else ring, axis=0)
    hole = " ".join(f"{x},{y}" for x, y in (np.array(ring) - middle) * 0.5 + middle)

    def poly(*, holed=False):
        inner = f"<innerBoundaryIs><LinearRing><coordinates>{hole}</coordinates></LinearRing>"
        return (
            f"<Polygon>{inner + '</innerBoundaryIs>' if holed else ''}<outerBoundaryIs><LinearRing>"
            f"<coordinates>{text}</coordinates></LinearRing></outerBoundaryIs></Polygon>"
        )

    point = "<Point><coordinates>1,2</coordinates></Point>"
    marks = [
        poly(holed=True),
        f"<MultiGeometry>{poly()}{point}</MultiGeometry>",
        point,
        "",
        poly().replace(text.split()[0], "x,"),
    ]
    path = tmp_path / "areas.kml"
    path.write_text("<kml>" + "".join(f"<Placemark>{m}</Placemark>" for m in marks) + "</kml>")
    found = read_areas(path, beach, BEACH)
    holed, collected, lone, empty, odd = found.areas
    assert holed.polygon.area == pytest.approx(75, rel=1e-6)
    assert collected.polygon.area == pytest.approx(100, rel=1e-6)
    assert "1 members of its collection are not polygons" in " ".join(found.warnings)
    assert "is a Point" in lone.error
    assert "no geometry" in empty.error
    assert "not a number" in odd.error


# --- databases that compute


def geopackage(path):
    names = [np.array(["Pile"], dtype=object)]
    geometry = np.array([shapely.to_wkb(shapely.Polygon(SQUARE))], dtype=object)
    raw.write(
        path, geometry, names, ["name"], geometry_type="Polygon", driver="GPKG", crs="EPSG:32615"
    )
    return path


COMPUTED = {
    "a view as a layer": [
        "ALTER TABLE areas RENAME TO hidden",
        "CREATE VIEW areas AS SELECT fid, geom, name FROM hidden",
    ],
    "a virtual table": ["CREATE VIRTUAL TABLE other USING fts4(body)"],
    "a generated column": [
        "ALTER TABLE areas ADD COLUMN more TEXT AS (ogr_geocode('x', 'geometry'))",
    ],
}


@pytest.mark.parametrize("kind", COMPUTED)
def test_geopackage_that_computes_is_refused(kind, tmp_path, beach):
    path = geopackage(tmp_path / "areas.gpkg")
    with sqlite3.connect(path) as database:
        for name, sql in database.execute(
            "SELECT name, sql FROM sqlite_master WHERE type = 'trigger'"
        ).fetchall():
            assert sql
            database.execute(f'DROP TRIGGER "{name}"')
        try:
            for statement in COMPUTED[kind]:
                database.execute(statement)
        except sqlite3.OperationalError as error:
            pytest.skip(f"this SQLite cannot make one: {error}")
    database.close()
    with pytest.raises(AreaError, match="computed by the database"):
        read_areas(path, beach, BEACH)


def test_geopackage_with_a_view_beside_its_layer_is_read(tmp_path, beach):
    path = geopackage(tmp_path / "areas.gpkg")
    with sqlite3.connect(path) as database:
        database.execute("CREATE VIEW other AS SELECT fid FROM areas")
    database.close()
    before = path.read_bytes()
    assert only(read_areas(path, beach, BEACH)).name == "Pile"
    assert path.read_bytes() == before


def test_geopackage_of_a_running_program_is_read_with_its_latest_changes(tmp_path, beach):
    path = geopackage(tmp_path / "areas.gpkg")
    database = sqlite3.connect(path)
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("UPDATE gpkg_contents SET description = 'changed'")
    database.execute("CREATE TABLE plain (a INTEGER)")
    for (name,) in database.execute(
        "SELECT name FROM sqlite_master WHERE type = 'trigger'"
    ).fetchall():
        database.execute(f'DROP TRIGGER "{name}"')
    database.execute("UPDATE areas SET name = 'Newer'")
    database.commit()
    listed = sorted(os.listdir(tmp_path))
    assert only(read_areas(path, beach, BEACH)).name == "Newer"
    assert sorted(os.listdir(tmp_path)) == listed
    database.close()


def test_geopackage_in_the_middle_of_a_change_is_refused(tmp_path, beach):
    path = geopackage(tmp_path / "areas.gpkg")
    (tmp_path / "areas.gpkg-journal").write_bytes(b"x")
    with pytest.raises(AreaError, match="being changed by another program"):
        read_areas(path, beach, BEACH)


# --- what lies beside a shapefile


def shapefile(path):
    names = [np.array(["Pile"], dtype=object)]
    geometry = np.array([shapely.to_wkb(shapely.Polygon(SQUARE))], dtype=object)
    raw.write(
        path,
        geometry,
        names,
        ["name"],
        geometry_type="Polygon",
        driver="ESRI Shapefile",
        crs="EPSG:32615",
    )
    return path


@pytest.mark.parametrize("part", [".shx", ".dbf", ".prj", ".cpg"])
def test_part_of_a_shapefile_that_is_a_link_to_elsewhere_is_refused(part, tmp_path, beach):
    path = shapefile(tmp_path / "areas.shp")
    private = tmp_path / "private"
    private.mkdir()
    (private / "secret").write_text("secret")
    path.with_suffix(part).unlink()
    path.with_suffix(part).symlink_to(private / "secret")
    with pytest.raises(AreaError, match="link to another folder") as caught:
        read_areas(path, beach, BEACH)
    assert "secret" not in str(caught.value)


def test_links_to_a_shapefile_are_followed_as_one(tmp_path, beach):
    store = tmp_path / "store"
    store.mkdir()
    path = shapefile(store / "areas.shp")
    link = tmp_path / "areas.shp"
    link.symlink_to(path)
    area = only(read_areas(link, beach, BEACH))
    assert area.name == "Pile"
    assert area.polygon.area == pytest.approx(100)


def test_a_shapefile_in_capitals_keeps_what_belongs_to_it(tmp_path, beach):
    path = shapefile(tmp_path / "areas.shp")
    for part in tmp_path.glob("areas.*"):
        part.rename(part.with_name(f"areas{part.suffix.upper()}"))
    area = only(read_areas(path.with_suffix(".SHP"), beach, BEACH))
    assert area.polygon.area == pytest.approx(100.0)


def test_what_is_missing_is_named_as_the_user_knows_it(tmp_path, beach):
    path = shapefile(tmp_path / "areas.shp")
    path.with_suffix(".shx").unlink()
    with pytest.raises(AreaError, match=r"areas\.shp: areas\.shx is missing beside it; copy"):
        read_areas(path, beach, BEACH)
