"""EPT: its files are only trusted as far as they are checked."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, List, Mapping

import pytest
from clouds import points, read_all, write_ept, write_las

from quantify_client.cloud import open_cloud
from quantify_client.cloud.ept import index as ept_index
from quantify_client.errors import CloudError


@pytest.fixture
def ept(tmp_path: Path) -> Path:
    return write_ept(tmp_path / "ept", points(500))


def _change(path: Path, **values: Any) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text()), **values}))


def test_missing_tile_is_an_error(ept: Path) -> None:
    (ept.parent / "ept-data" / "0-0-0-0.laz").unlink()
    with pytest.raises(CloudError, match="is missing"):
        read_all(open_cloud([ept]))


def test_tile_with_other_than_its_points_is_an_error(ept: Path) -> None:
    write_las(ept.parent / "ept-data" / "0-0-0-0.laz", points(99))
    with pytest.raises(CloudError, match="holds 99 points, the hierarchy promises 100"):
        read_all(open_cloud([ept]))


def test_hierarchy_with_other_than_the_points_promised_is_an_error(ept: Path) -> None:
    _change(ept, points=501)
    with pytest.raises(CloudError, match="promises 501 points, its hierarchy holds 500"):
        open_cloud([ept])


def test_missing_part_of_the_hierarchy_is_an_error(ept: Path) -> None:
    next((ept.parent / "ept-hierarchy").glob("1-*.json")).unlink()
    with pytest.raises(CloudError, match=r"ept-hierarchy/1-.*cannot be read"):
        open_cloud([ept])


@pytest.mark.parametrize(
    "key", ["../../secret", "0-0-0-0/../x", "1-2-0-0", "-1-0-0-0", "0-0-0", "1-0-0-0\n", "99-0-0-0"]
)
def test_keys_that_are_no_tiles_are_refused(ept: Path, key: str) -> None:
    _change(ept.parent / "ept-hierarchy" / "0-0-0-0.json", **{key: 5})
    with pytest.raises(CloudError, match="level-x-y-z") as caught:
        open_cloud([ept])
    assert "\n" not in str(caught.value)


def test_links_out_of_the_folder_are_refused(ept: Path, tmp_path: Path) -> None:
    tile = ept.parent / "ept-data" / "0-0-0-0.laz"
    outside = tmp_path / "outside.laz"
    tile.rename(outside)
    tile.symlink_to(outside)
    with pytest.raises(CloudError, match="leads out of its EPT folder"):
        read_all(open_cloud([ept]))


def test_compression_that_is_not_read_is_named(ept: Path) -> None:
    _change(ept, dataType="zstandard")
    with pytest.raises(CloudError, match="'zstandard'; expected laszip"):
        open_cloud([ept])


@pytest.mark.parametrize(
    "values",
    [{"bounds": [1, 2, 3]}, {"bounds": [0, 0, 0, -1, 1, 1]}, {"points": "x"}, {"bounds": None}],
)
def test_nonsense_in_ept_json_is_one_line(ept: Path, values: Any) -> None:
    _change(ept, **values)
    with pytest.raises(CloudError) as caught:
        open_cloud([ept])
    assert "\n" not in str(caught.value)


def test_ept_json_that_is_no_json_is_one_line(ept: Path) -> None:
    for text in ("{", "[]", "{}"):
        ept.write_text(text)
        with pytest.raises(CloudError):
            open_cloud([ept])


def test_oversized_index_is_refused(ept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ept_index, "_MAX_JSON", 10)
    with pytest.raises(CloudError, match="no EPT index"):
        open_cloud([ept])


def test_binary_tile_of_another_size_is_an_error(tmp_path: Path) -> None:
    path = write_ept(tmp_path / "ept", points(500), "binary")
    tile = path.parent / "ept-data" / "0-0-0-0.bin"
    tile.write_bytes(tile.read_bytes()[:-1])
    with pytest.raises(CloudError, match="has 1199 bytes, 100 points take 1200"):
        read_all(open_cloud([path]))


def test_index_that_holds_more_than_is_promised_is_given_up_at_once(tmp_path: Path) -> None:
    ept = write_ept(tmp_path / "ept", points(500))
    asked: List[str] = []

    def fetch(wanted: Mapping[str, int]) -> None:
        for name in wanted:
            key = f"50-{len(asked)}-0-0"
            asked.append(name)
            (ept.parent / name).write_text(json.dumps({"0-0-0-0": 501, key: -1}))

    with pytest.raises(CloudError, match=r"501 points; ept\.json promises 500"):
        ept_index.read_index(ept, fetch)
    assert len(asked) == 1


def test_parts_are_counted_before_they_are_fetched(ept: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr(ept_index, "_MAX_PARTS", 30)
    asked: List[str] = []

    def fetch(wanted: Mapping[str, int]) -> None:
        asked.extend(wanted)
        many = {f"40-{number}-0-0": -1 for number in range(31)}
        (ept.parent / next(iter(wanted))).write_text(json.dumps(many))

    with pytest.raises(CloudError, match="more than 30 parts"):
        ept_index.read_index(ept, fetch)
    assert len(asked) == 1


def test_tiles_are_counted(ept: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr(ept_index, "_MAX_TILES", 2)
    with pytest.raises(CloudError, match="2 tiles are read at most"):
        open_cloud([ept])
