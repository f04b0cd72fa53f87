"""What the user points at: files, folders and tiles."""

from __future__ import annotations

import os
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from clouds import ORIGIN, points, read_all, write_ept, write_las, write_ply

from quantify_client.errors import CloudError
from quantify_client.source import open_source

COORDS = f"WGS84 UTM 15N\n{ORIGIN[0]:.0f} {ORIGIN[1]:.0f}\n"
PROJ = "+proj=utm +zone=15 +datum=WGS84 +units=m +no_defs +type=crs\n"


def _project(root: Path, name: str = "odm_georeferenced_model.laz", coords: str = COORDS) -> Path:
    folder = root / "odm_georeferencing"
    folder.mkdir(parents=True)
    write_las(folder / name, points(100))
    if coords:
        (folder / "coords.txt").write_text(coords)
    return root


def _refused(source: Any, message: str) -> str:
    with pytest.raises(CloudError, match=message) as caught, open_source([source]):
        pass
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    "given",
    ["", "odm_georeferencing", "odm_georeferencing/odm_georeferenced_model.laz"],
)
def test_odm_output_is_found_by_project_folder_and_file(given: str, tmp_path: Path) -> None:
    root = _project(tmp_path / "quarry")
    with open_source([root / given]) as source:
        assert np.allclose(read_all(source.cloud), points(100), rtol=0, atol=1e-6)
        assert source.is_odm
        assert source.stem == "quarry"
        assert source.label == str(root / given)
        assert (source.cloud.info.crs, source.cloud.info.crs_origin) == ("EPSG:32615", "coords.txt")
        (entry,) = source.inputs
        model = root / "odm_georeferencing" / "odm_georeferenced_model.laz"
        assert entry["path"] == str(model)
        assert entry["size"] == model.stat().st_size
        changed = datetime.fromisoformat(entry["mtime"])
        assert changed.timestamp() == pytest.approx(model.stat().st_mtime, abs=1e-3)
        assert changed.utcoffset().total_seconds() == 0


def test_formats_are_preferred_in_order(tmp_path: Path) -> None:
    root = _project(tmp_path / "p", "odm_georeferenced_model.las")
    write_ply(root / "odm_georeferencing" / "odm_georeferenced_model.ply", points(50))
    write_ept(root / "entwine_pointcloud", points(60))
    with open_source([root]) as source:
        assert source.cloud.info.format == "las"
    (root / "odm_georeferencing" / "odm_georeferenced_model.las").unlink()
    with open_source([root]) as source:
        assert source.cloud.info.format == "ply"
    (root / "odm_georeferencing" / "odm_georeferenced_model.ply").unlink()
    with open_source([root]) as source:
        assert (source.cloud.info.format, source.stem) == ("ept", "p")


def test_cloud_before_georeferencing_is_the_last_resort(tmp_path: Path) -> None:
    folder = tmp_path / "p" / "odm_filterpoints"
    folder.mkdir(parents=True)
    write_ply(folder / "point_cloud.ply", points(50) - ORIGIN)
    with open_source([tmp_path / "p"]) as source:
        assert source.cloud.info.crs is None
        assert "before georeferencing" in source.cloud.info.warnings[-1]


def test_proj_txt_is_used_where_coords_txt_is_missing(tmp_path: Path) -> None:
    root = _project(tmp_path / "p", coords="")
    (root / "odm_georeferencing" / "proj.txt").write_text(PROJ)
    with open_source([root]) as source:
        assert source.cloud.info.crs == PROJ.strip()
        assert source.cloud.info.crs_origin == "proj.txt"


def test_southern_zone_is_told_from_the_northern(tmp_path: Path) -> None:
    root = _project(tmp_path / "p", coords="WGS84 UTM 7S\n576000 5188000\n")
    with open_source([root]) as source:
        assert source.cloud.info.crs == "EPSG:32707"


def test_crs_of_another_place_is_not_taken(tmp_path: Path) -> None:
    root = _project(tmp_path / "p", coords="WGS84 UTM 15N\n200000 100\n")
    with open_source([root]) as source:
        assert source.cloud.info.crs is None
        assert "nowhere near" in source.cloud.info.warnings[-1]


def test_crs_of_the_file_itself_goes_first(tmp_path: Path) -> None:
    root = _project(tmp_path / "p", coords="WGS84 UTM 16N\n576700 5188140\n")
    model = root / "odm_georeferencing" / "odm_georeferenced_model.laz"
    write_las(model, points(10), 6, "1.4", crs="EPSG:32615")
    with open_source([root]) as source:
        assert source.cloud.info.crs_origin == "LAS WKT record"


def test_coords_txt_beside_a_foreign_cloud_means_nothing(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz", points(10))
    (tmp_path / "coords.txt").write_text(COORDS)
    with open_source([path]) as source:
        assert source.cloud.info.crs is None
        assert not source.is_odm


def test_folder_of_tiles_is_one_survey(tmp_path: Path) -> None:
    xyz = points(100)
    folder = tmp_path / "survey"
    folder.mkdir()
    write_las(folder / "a.laz", xyz[:30])
    write_las(folder / "b.LAS", xyz[30:])
    (folder / "notes.txt").write_text("by hand")
    with open_source([folder]) as source:
        assert np.allclose(read_all(source.cloud), xyz, rtol=0, atol=1e-6)
        assert [Path(entry["path"]).name for entry in source.inputs] == ["a.laz", "b.LAS"]
        assert (source.stem, source.is_odm) == ("survey", False)


def test_several_sources_are_one_survey(tmp_path: Path) -> None:
    xyz = points(100)
    one = write_las(tmp_path / "a.laz", xyz[:30])
    two = write_ply(tmp_path / "b.ply", xyz[30:])
    with open_source([str(one), two]) as source:
        assert len(read_all(source.cloud)) == 100
        assert source.label == f"{one} {two}"
        assert source.stem == tmp_path.name
        assert len(source.inputs) == 2


def test_sources_in_different_crs_are_refused(tmp_path: Path) -> None:
    one = _project(tmp_path / "a")
    two = _project(tmp_path / "b", coords=COORDS.replace("15N", "16N"))
    with pytest.raises(CloudError, match="different CRS"), open_source([one, two]):
        pass


@pytest.mark.parametrize(
    ("name", "stem"),
    [("pile.laz", "pile"), ("pile.copc.laz", "pile"), ("a.b.laz", "a.b")],
)
def test_stem_is_the_name_of_the_file(name: str, stem: str, tmp_path: Path) -> None:
    with open_source([write_las(tmp_path / name, points(10))]) as source:
        assert source.stem == stem


def test_relative_paths_have_a_stem_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = _project(tmp_path / "quarry")
    for place, given in [(root, "."), (root / "odm_georeferencing", ".")]:
        monkeypatch.chdir(place)
        with open_source([given]) as source:
            assert source.stem == "quarry"
            assert source.cloud.info.crs == "EPSG:32615"


def test_project_one_folder_down_is_found_if_it_is_alone(tmp_path: Path) -> None:
    _project(tmp_path / "task" / "one")
    with open_source([tmp_path / "task"]) as source:
        assert source.is_odm
    _project(tmp_path / "task" / "two")
    _refused(tmp_path / "task", "holds 2 ODM projects")


def test_folder_without_a_cloud_says_what_was_looked_for(tmp_path: Path) -> None:
    _refused(tmp_path, r"odm_georeferenced_model\.laz.*ept\.json.*tiles")


@pytest.mark.parametrize("url", ["https://host/project/1/task/2/?token=secret", "http://h/all.zip"])
def test_web_address_is_refused_without_showing_its_query(url: str) -> None:
    assert "secret" not in _refused(url, r"download the all\.zip")


def test_missing_source_is_named(tmp_path: Path) -> None:
    with pytest.raises(CloudError, match="does not exist"), open_source([tmp_path / "nothing"]):
        pass
    with pytest.raises(CloudError, match="no source"), open_source([]):
        pass


def test_lfs_pointer_in_place_of_the_model_is_named(tmp_path: Path) -> None:
    root = _project(tmp_path / "p")
    model = root / "odm_georeferencing" / "odm_georeferenced_model.laz"
    model.write_bytes(b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n")
    with pytest.raises(CloudError, match="git lfs pull"), open_source([root]):
        pass


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_folder_without_permission_is_named(tmp_path: Path) -> None:
    root = _project(tmp_path / "p")
    root.chmod(0)
    try:
        with pytest.raises(CloudError, match="no permission"), open_source([root]):
            pass
    finally:
        root.chmod(0o700)


def test_folder_that_refuses_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", refuse)
    with pytest.raises(CloudError, match="no permission"), open_source([tmp_path]):
        pass
