"""Design surfaces from LandXML and DXF."""

from __future__ import annotations

import builtins

import ezdxf
import numpy as np
import pytest

from quantify_client.design.read import read_design
from quantify_client.errors import DesignError, MissingExtraError

EAST, NORTH = 576_700.0, 5_188_140.0
PLACES = [(EAST, NORTH, 10.0), (EAST + 8, NORTH, 12.5), (EAST + 8, NORTH + 4, 11.0)]
PLACES += [(EAST, NORTH + 4, 9.25)]


def landxml(points=PLACES, faces=("7 8 9", "7 9 10"), head="", surface="Pad", kind="TIN", more=""):
    rows = "".join(f'<P id="{7 + i}">{y!r} {x!r} {z!r}</P>' for i, (x, y, z) in enumerate(points))
    each = "".join(face if face.startswith("<") else f"<F>{face}</F>" for face in faces)
    return (
        f'<?xml version="1.0"?><LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" '
        f'version="1.2">{head}<Surfaces><Surface name="{surface}">'
        "<SourceData><Breaklines><Breakline><PntList3D>1 2 3</PntList3D></Breakline></Breaklines>"
        f'</SourceData><Definition surfType="{kind}"><Pnts>{rows}</Pnts><Faces>{each}</Faces>'
        f"</Definition></Surface>{more}</Surfaces></LandXML>"
    )


@pytest.fixture
def read(tmp_path):
    def read(text, name="pad.xml"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_design(path)

    return read


def corners(design):
    """Return the triangles as sets of places."""
    return {frozenset(map(tuple, design.points[one].tolist())) for one in design.triangles}


WANTED = {frozenset(PLACES[i] for i in face) for face in ((0, 1, 2), (0, 2, 3))}


def test_landxml_has_northing_before_easting(read):
    head = '<Units><Imperial linearUnit="USSurveyFoot"/></Units><CoordinateSystem epsgCode="2255"/>'
    design = read(landxml(head=head))
    assert corners(design) == WANTED
    assert (design.crs, design.unit, design.warnings) == ("EPSG:2255", "us-ft", ())
    bare = read(landxml())
    assert (bare.crs, bare.unit) == (None, None)
    wkt = '<CoordinateSystem epsgCode="" ogcWktCode="LOCAL_CS[&quot;site&quot;]"/>'
    assert read(landxml(head=wkt)).crs == 'LOCAL_CS["site"]'


def test_invisible_faces_are_no_surface(read):
    design = read(landxml(faces=("7 8 9", '<F i="1">7 9 10</F>', '<F i="0" n="1 2 0">7 9 10</F>')))
    assert corners(design) == WANTED
    assert len(design.triangles) == 2


def test_the_only_tin_beside_a_grid_is_read(read):
    grid = '<Surface><Definition surfType="grid"><Pnts><P>1 2</P></Pnts></Definition></Surface>'
    assert corners(read(landxml(more=grid))) == WANTED


def test_vertical_faces_are_left_out_and_counted(read):
    points = [*PLACES, (EAST, NORTH, 3.0)]
    design = read(landxml(points, ("7 8 9", "7 9 10", "7 8 11")))
    assert corners(design) == WANTED
    assert [notice.code for notice in design.warnings] == ["design-vertical-faces"]


TWO = '<Surface name="Rock&#10;"><Definition surfType="TIN"><Pnts/><Faces/></Definition></Surface>'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (landxml(more=TWO), "holds 2 TIN surfaces ('Pad', 'Rock\\n')"),
        (landxml(kind="grid"), "holds a surface of type 'grid'"),
        (landxml(faces=()), "a TIN without visible faces"),
        (landxml(faces=("7 8 99",)), "face 1 is '7 8 99'"),
        (landxml(faces=("7 8 9 10",)), "face 1 is '7 8 9 10'"),
        (landxml().replace('id="8"', 'id="7"'), "two points with id '7'"),
        (landxml().replace(" 12.5<", "<"), "point 8 is '5188140.0 576708.0'; expected northing"),
        (landxml().replace("12.5", "nan"), "no number or beyond"),
        (landxml().replace("12.5", "1e30"), "no number or beyond"),
        (landxml().replace("12.5", "high"), "point 8 is"),
        (landxml(PLACES[:2] + PLACES[:1], ("7 8 9",)), "no faces that cover any ground"),
        (landxml(head='<Units><Imperial linearUnit="mile"/></Units>'), "its unit is 'mile'"),
        (landxml()[:-40], "not valid LandXML"),
        ("<kml/>", "its root is <kml>"),
        ("<LandXML>" + "<a>" * 300, "nested too deeply"),
        (
            '<!DOCTYPE LandXML [<!ENTITY a SYSTEM "file:///etc/passwd">]>' + landxml()[21:],
            "document",
        ),
        ('<?xml version="1.0" encoding="none"?><LandXML/>', "not valid LandXML"),
        ("<LandXML/>", "holds no surface"),
        (b"", "is empty"),
    ],
)
def test_a_landxml_that_is_no_surface_is_one_line(text, said, read):
    with pytest.raises(DesignError) as caught:
        read(text)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_sizes_are_capped(read, monkeypatch):
    module = "quantify_client.design."
    monkeypatch.setattr(module + "landxml.MAX_POINTS", 3)
    with pytest.raises(DesignError, match="more than 3 points"):
        read(landxml())
    monkeypatch.setattr(module + "landxml._MOST_ELEMENTS", 20)
    with pytest.raises(DesignError, match="more than 20 elements"):
        read(landxml())
    monkeypatch.setattr(module + "landxml.MAX_BYTES", 100)
    with pytest.raises(DesignError, match="larger than"):
        read(landxml())
    monkeypatch.setattr(module + "dxf._MOST_ENTITIES", 2)
    with pytest.raises(DesignError, match="more than 2 3DFACE"):
        read("0\nSECTION\n" + "0\n3DFACE\n" * 3 + "0\nEOF\n", "pad.dxf")


def drawing(unit=6):
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = unit
    return document, document.modelspace()


def dxf_text(document):
    import io

    out = io.StringIO()
    document.write(out)
    return out.getvalue()


def faces(space):
    space.add_3dface([*PLACES[:3], PLACES[2]])  # as programs write a triangle
    space.add_3dface([PLACES[0], PLACES[2], PLACES[3]])


def quad(space):
    space.add_3dface(PLACES)


def polyface(space):
    from ezdxf.render import MeshBuilder

    mesh = MeshBuilder()
    mesh.vertices, mesh.faces = list(PLACES), [(0, 1, 2), (0, 2, 3)]
    mesh.render_polyface(space)


def mesh(space):
    with space.add_mesh().edit_data() as data:
        data.vertices, data.faces = list(PLACES), [(0, 1, 2), (0, 2, 3)]


@pytest.mark.parametrize("draw", [faces, quad, polyface, mesh])
@pytest.mark.parametrize(("code", "unit"), [(6, "m"), (21, "us-ft"), (0, None)])
def test_faces_of_a_dxf(draw, code, unit, read):
    document, space = drawing(code)
    draw(space)
    space.add_line((0, 0), (1, 1))
    design = read(dxf_text(document), "pad.dxf")
    assert corners(design) == WANTED
    assert (design.crs, design.unit, design.warnings) == (None, unit, ())


def test_a_dxf_of_inches_or_several_layers_is_told(read):
    document, space = drawing(1)
    faces(space)
    space.add_3dface([(x + 50, y, z) for x, y, z in PLACES[:3]], dxfattribs={"layer": "EG"})
    design = read(dxf_text(document), "pad.dxf")
    assert [notice.code for notice in design.warnings] == ["design-unit-unknown", "design-layers"]
    assert "'0' 2, 'EG' 1" in design.warnings[1]
    assert design.unit is None


def test_a_dxf_that_is_no_surface_is_one_line(read):
    document, space = drawing()
    space.add_line((0, 0), (1, 1))
    empty = dxf_text(document)
    faces(space)
    whole = dxf_text(document)
    broken = whole[: whole.index("AcDbFace")] + "\n10\nfar\n" + whole[whole.index("AcDbFace") :]
    for text, said in (
        (empty, "holds no faces"),
        (b"AutoCAD Binary DXF\r\n\x1a\x00", "not a DXF in text form"),
        (whole[: whole.index("AcDbFace")], "is truncated"),
        ("0\nSECTION\n2\nENTITIES\n0\n3DFACE\n8\n0\n10\nx\n0\nENDSEC\n0\nEOF", "cannot be read"),
        (broken, "cannot be read"),
    ):
        with pytest.raises(DesignError) as caught:
            read(text, "pad.dxf")
        assert said in str(caught.value)
        assert "\n" not in str(caught.value)


def test_a_dxf_without_its_library_says_how_to_add_it(read, monkeypatch):
    document, space = drawing()
    faces(space)
    text, real = dxf_text(document), builtins.__import__

    def without(name, *args, **kwargs):
        if name.startswith("ezdxf"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtraError, match=r"needs ezdxf.*export the surface as LandXML"):
        read(text, "pad.dxf")


def test_other_endings_are_refused(tmp_path):
    with pytest.raises(DesignError, match=r"unknown ending; expected .*\.landxml"):
        read_design(tmp_path / "pad.dwg")


def test_points_of_a_dxf_are_joined(read):
    document, space = drawing()
    for x in range(20):
        for y in range(20):
            space.add_3dface([(x, y, 0), (x + 1, y, 0), (x + 1, y + 1, 1), (x, y + 1, 1)])
    design = read(dxf_text(document), "grid.dxf")
    assert len(design.triangles) == 800
    assert len(design.points) == len(np.unique(design.points, axis=0)) == 2 * 20 * 21
