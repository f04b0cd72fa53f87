"""A report is written completely or not at all, and replaces only what is ours."""

from __future__ import annotations

import errno
import json
import sys
from pathlib import Path
from typing import Any, Dict, Iterator

import pytest
from PIL import Image

from quantify_client import write_report
from quantify_client.errors import MissingExtraError, OutputError
from quantify_client.report.page import page as htmlout
from quantify_client.report.write import require_writable

from . import surveys

NAMES = [
    "report.json",
    "slices.csv",
    "areas.geojson",
    "overview.png",
    "area-01-north-pile.png",
    "area-02-grassy-hollow.png",
    "area-04-cmd.png",
    "report.html",
]


def contents(folder: Path) -> Dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("report") / "deep" / "out"
    written = write_report(surveys.everything(), out)
    assert [path.name for path in written] == NAMES
    return out


@pytest.fixture
def earlier(tmp_path: Path) -> Iterator[Path]:
    out = tmp_path / "out"
    write_report(surveys.measurement(surveys.body("Old")), out)
    (out / "notes.txt").write_text("mine")
    return out


def test_all_files_exist_and_nothing_else(first: Path) -> None:
    assert sorted(contents(first)) == sorted(NAMES)
    document = json.loads((first / "report.json").read_text("utf-8"))
    assert [row["name"] for row in document["results"]][2] == surveys.HOSTILE
    html = (first / "report.html").read_text("utf-8")
    assert html.count("data:image/png;base64,") == 4
    assert json.loads((first / "areas.geojson").read_text("utf-8"))["type"] == "FeatureCollection"
    assert (first / "slices.csv").read_bytes().startswith(b"name,z_m,height_m,area_m2,")


def test_us_units_change_no_file_for_programs(tmp_path: Path) -> None:
    measurement = surveys.measurement(surveys.body())
    metric, us = tmp_path / "metric", tmp_path / "us"
    write_report(measurement, metric)
    write_report(measurement, us, units="us")
    for name in ("report.json", "slices.csv", "areas.geojson"):
        assert (metric / name).read_bytes() == (us / name).read_bytes()
    assert (metric / "report.html").read_bytes() != (us / "report.html").read_bytes()


def test_stale_pictures_go_and_foreign_files_stay(earlier: Path) -> None:
    Image.new("RGB", (2, 2)).save(earlier / "area-09-holiday.png")
    Image.new("RGB", (2, 2)).save(earlier / "overview.png")
    assert (earlier / "area-01-old.png").exists()
    write_report(surveys.measurement(surveys.body("New")), earlier)
    names = set(contents(earlier))
    assert "area-01-new.png" in names
    assert "area-01-old.png" not in names
    assert {"area-09-holiday.png", "overview.png", "notes.txt"} <= names


def disk_full(*_args: Any, **_kwargs: Any) -> Any:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_leaves_the_earlier_report(
    earlier: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = contents(earlier)
    monkeypatch.setattr(htmlout, "render_html", disk_full)
    with pytest.raises(OutputError, match="No space left on device") as caught:
        write_report(surveys.measurement(surveys.body("New")), earlier)
    assert "\n" not in str(caught.value)
    assert contents(earlier) == before


@pytest.mark.parametrize("fail_at", [0, 2, 4])
def test_a_failure_while_moving_puts_the_earlier_report_back(
    earlier: Path, monkeypatch: pytest.MonkeyPatch, fail_at: int
) -> None:
    before = contents(earlier)
    moves = iter(range(100))
    move = Path.replace

    def fail_once(self: Path, target: Any) -> Any:
        if next(moves) == fail_at:
            disk_full()
        return move(self, target)

    monkeypatch.setattr(Path, "replace", fail_once)
    with pytest.raises(OutputError):
        write_report(surveys.measurement(surveys.body("New")), earlier)
    assert contents(earlier) == before


def test_a_failed_first_report_leaves_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(htmlout, "render_html", disk_full)
    with pytest.raises(OutputError):
        write_report(surveys.measurement(surveys.body()), tmp_path / "a" / "b")
    assert list(tmp_path.iterdir()) == []


def test_an_interruption_cleans_up_too(earlier: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = contents(earlier)

    def interrupt(*_args: Any, **_kwargs: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr(htmlout, "render_html", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_report(surveys.measurement(surveys.body()), earlier)
    assert contents(earlier) == before


def test_out_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    for out in (tmp_path / "out", tmp_path / "out" / "below"):
        with pytest.raises(OutputError, match="--out") as caught:
            write_report(surveys.measurement(surveys.body()), out)
        assert "\n" not in str(caught.value)
    assert (tmp_path / "out").read_text() == "mine"


def test_a_folder_in_the_place_of_a_file_is_refused(earlier: Path) -> None:
    (earlier / "report.json").unlink()
    (earlier / "report.json").mkdir()
    before = sorted(path.name for path in earlier.iterdir())
    with pytest.raises(OutputError, match="is a folder"):
        write_report(surveys.measurement(surveys.body("New")), earlier)
    assert sorted(path.name for path in earlier.iterdir()) == before


def test_a_measurement_of_failures_only_is_reported(tmp_path: Path) -> None:
    written = write_report(surveys.measurement(surveys.failure()), tmp_path)
    assert [path.name for path in written] == [n for n in NAMES if not n.endswith(".png")]


def test_without_matplotlib_a_report_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for write in (
        lambda: write_report(surveys.measurement(surveys.pile()), tmp_path / "out"),
        lambda: require_writable(tmp_path / "out"),
    ):
        with pytest.raises(MissingExtraError, match="a report needs matplotlib, .*pip install mat"):
            write()
    assert list(tmp_path.iterdir()) == []
