"""Pictures of an alignment, a series and a stage curve, and the files they are written to."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path
from typing import Any, Tuple

import numpy as np
import pytest
from PIL import Image

from quantify_client import write_report
from quantify_client.report.figures.change import alignment_picture, limits_of
from quantify_client.report.figures.pictures import area_picture
from quantify_client.report.figures.series import area_series, series_picture, short_names
from quantify_client.report.figures.stage import stage_picture
from quantify_client.report.figures.terrain import shading
from quantify_client.report.wording.units import METRIC, US
from quantify_client.types import StableGround, Stage

from . import changes, surveys

# Drawn by the same matplotlib on either Python.
pytestmark = pytest.mark.one_python


def size_of(png: bytes) -> Tuple[int, int]:
    image = Image.open(io.BytesIO(png))
    assert image.format == "PNG"
    assert len(np.unique(np.asarray(image.convert("L")))) > 20  # something is drawn
    return image.size


def test_an_alignment_is_drawn_whatever_is_known() -> None:
    some = changes.stable_ground(2000)
    nothing = StableGround(np.array([]), np.array([np.nan]))
    for ground in (some, nothing, StableGround(some.after_m, np.zeros(5))):
        for aligned in (changes.aligned(), changes.aligned(aligned=False, before_rms_m=None)):
            assert size_of(alignment_picture(ground, aligned, US)) == (1400, 520)


def test_outliers_do_not_widen_the_histogram() -> None:
    ground = changes.stable_ground()
    low, high = limits_of(ground.before_m, ground.after_m)
    assert low == -high
    assert 0.4 < high < 0.8  # 0.1 + 2.3 x 0.2 m, far from 9 m


def test_sums_of_a_series_end_where_one_is_not_known() -> None:
    one, two = area_series(changes.series(4, 2))
    assert one.sums == pytest.approx([0.0, 120.0, 152.1, 49.27], abs=0.01)
    assert one.whole == pytest.approx(53.27, abs=0.01)
    assert np.isnan(two.changes).tolist() == [False, True, False]
    assert np.isfinite(two.sums).tolist() == [True, True, False, False]
    assert two.intervals[1] is None


def test_one_pair_is_no_sum_of_others() -> None:
    [one] = area_series(changes.series(2, 1))
    assert one.whole is None
    assert one.sums == pytest.approx([0.0, 120.0])


@pytest.mark.parametrize(("count", "areas", "rows"), [(2, 1, 1), (3, 2, 1), (10, 6, 3), (4, 9, 3)])
def test_a_series_of_any_length_is_drawn(count: int, areas: int, rows: int) -> None:
    wide, high = size_of(series_picture(changes.series(count, areas), METRIC))
    assert wide == 1400
    assert high == pytest.approx(135 + 425 * rows, abs=1)


def test_a_series_in_which_nothing_was_measured_is_drawn() -> None:
    failed = [
        dataclasses.replace(pair, results=(), failures=(surveys.failure(),))
        for pair in changes.series(3, 1)
    ]
    size_of(series_picture(failed, METRIC))


def test_names_of_surveys_lose_what_they_share() -> None:
    assert short_names(["site_may.las", "site_june.las"]) == ["site_may", "site_june"]
    assert short_names(["a.las", "a.las"]) == ["a", "a"]
    assert short_names([".las", "a.las"]) == [".las", "a"]
    assert short_names(["only.las"]) == ["only.las"]
    assert all(len(name) <= 16 for name in short_names(["x" * 90, "y" * 90 + "z"]))


def test_a_stage_curve_is_drawn_whatever_is_known() -> None:
    full = changes.stage()
    for stage in (full, Stage(full.levels[:1]), Stage(()), Stage((), full.pour_points)):
        assert size_of(stage_picture(surveys.hollow(), stage, US)) == (1400, 655)


def test_pour_points_are_marked_on_the_plan() -> None:
    measurement = surveys.measurement()
    drawn = [
        np.asarray(Image.open(io.BytesIO(area_picture(result, measurement, METRIC))).convert("L"))
        for result in (changes.pond(), surveys.hollow("Settling pond"))
    ]
    changed = np.argwhere((drawn[0] != drawn[1])[110:])  # below the head line
    assert len(changed) > 300
    assert changed[:, 1].max() < 780  # on the plan


def test_a_change_is_drawn_with_its_own_words() -> None:
    result = changes.changed()
    as_change = area_picture(result, changes.change(result), METRIC)
    as_volume = area_picture(result, surveys.measurement(result), METRIC)
    assert size_of(as_change) == size_of(as_volume)
    assert as_change != as_volume


def test_cells_without_a_change_are_those_of_the_coarse_grid() -> None:
    relief = changes.changed().relief
    assert relief is not None
    assert relief.undetected is not None
    left = np.zeros_like(relief.undetected)
    left[:, : left.shape[1] // 2] = True
    coarse = shading.coarse(dataclasses.replace(relief, undetected=left), 20)
    assert coarse.undetected is not None
    assert coarse.undetected.shape == coarse.elevation_m.shape
    inside = np.isfinite(coarse.above_base_m)
    middle = coarse.undetected.shape[1] // 2
    assert coarse.undetected[:, :middle][inside[:, :middle]].all()
    assert not coarse.undetected[:, middle:].any()
    assert shading.coarse(dataclasses.replace(relief, undetected=None), 20).undetected is None


def everything(**changed: Any) -> Any:
    known = {"stable_ground": changes.stable_ground(500), "series": changes.series(3, 1)}
    return changes.change(changes.changed(stage=changes.stage()), **{**known, **changed})


@pytest.fixture
def full(tmp_path: Path) -> Path:
    out = tmp_path / "out"
    names = [path.name for path in write_report(everything(), out)]
    assert names == [
        "report.json",
        "slices.csv",
        "areas.geojson",
        "series.csv",
        "stage.csv",
        "alignment.png",
        "series.png",
        "area-01-quarry-floor.png",
        "area-01-quarry-floor-stage.png",
        "report.html",
    ]
    assert sorted(names) == sorted(path.name for path in out.iterdir())
    return out


def test_all_pictures_are_in_the_page(full: Path) -> None:
    assert (full / "report.html").read_text("utf-8").count("data:image/png;base64,") == 4


def test_a_later_run_removes_pictures_it_has_no_use_for(full: Path) -> None:
    write_report(surveys.measurement(changes.changed()), full)
    assert sorted(path.name for path in full.glob("*.png")) == ["area-01-quarry-floor.png"]


def test_tables_of_others_stay(tmp_path: Path) -> None:
    (tmp_path / "stage.csv").write_text("mine")
    names = [path.name for path in write_report(everything(), tmp_path)]
    assert "stage-2.csv" in names
    assert "series.csv" in names
    assert (tmp_path / "stage.csv").read_text() == "mine"


def test_a_later_run_replaces_and_removes_tables(full: Path) -> None:
    write_report(everything(), full)
    assert sorted(path.name for path in full.glob("*.csv")) == [
        "series.csv",
        "slices.csv",
        "stage.csv",
    ]
    write_report(surveys.measurement(changes.changed()), full)
    assert [path.name for path in full.glob("*.csv")] == ["slices.csv"]
