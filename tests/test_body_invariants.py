"""What must not change the volume of a body: how its points come, and where and how large it is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Tuple

import numpy as np
import pytest
from clouds import write_las, write_ply
from hypothesis import given, settings
from hypothesis import strategies as st
from scans import OFFSET, Flaws, scan, volume_of
from scipy.spatial.transform import Rotation
from solids import BODIES

from quantify_client import measure
from quantify_client.cloud.ply.cloud import PlyCloud
from quantify_client.types import AreaResult

pytestmark = pytest.mark.one_python

COUNT = 2_000
NAMES = ["cube, rotated", "torus, lying", "four legs"]
FLAWS = Flaws(noise=0.003, outliers=0.005)


def points_of(name: str, count: int = COUNT, flaws: Flaws = FLAWS) -> np.ndarray:
    return scan(BODIES[name](), count, seed=1101, flaws=flaws)


@cache
def local_result(name: str) -> AreaResult:
    """Of the points near zero."""
    return volume_of(points_of(name) - OFFSET)


def numbers(*paths: Path, **options: Any) -> np.ndarray:
    """Everything that a result says in cubic metres, and what it left out."""
    (result,) = measure(*paths, shape="object", **options).results
    slices = [part.volume_m3 for part in result.slices]
    left_out = sum(result.points_left_out.values())
    return np.array([result.volume_m3, result.std_m3, left_out, *slices])


def assert_same(one: np.ndarray, other: np.ndarray) -> None:
    np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


# --- how the points come


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Tuple[Path, np.ndarray, np.ndarray]:
    """A file, its points and its result, which all others are compared with."""
    # Whole millimetres, which every format holds exactly.
    points = np.round(points_of("four legs"), 3)
    path = write_ply(tmp_path_factory.mktemp("bodies") / "whole.ply", points, extra=False)
    return path, points, numbers(path)


@pytest.mark.parametrize("size", [97, 5000])
def test_the_chunk_size_changes_nothing(
    whole: Tuple[Path, np.ndarray, np.ndarray], monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    path, _, expected = whole
    chunks = PlyCloud.chunks
    cut = []

    def in_pieces(self: PlyCloud, window: Any = None, *rest: Any, **named: Any) -> Any:
        for chunk in chunks(self, window, *rest, **named):
            for start in range(0, len(chunk), size):
                part = slice(start, start + size)
                cut.append(part)
                left_out = chunk.left_out if start == 0 else {}
                yield replace(
                    chunk, x=chunk.x[part], y=chunk.y[part], z=chunk.z[part], left_out=left_out
                )

    monkeypatch.setattr(PlyCloud, "chunks", in_pieces)
    assert_same(numbers(path), expected)
    assert len(cut) > 1


def test_the_order_of_points_and_of_tiles_changes_nothing(
    whole: Tuple[Path, np.ndarray, np.ndarray],
) -> None:
    path, points, expected = whole
    order = np.random.default_rng(1102).permutation(len(points))
    shuffled = write_ply(path.with_name("shuffled.ply"), points[order], extra=False)
    assert_same(numbers(shuffled), expected)
    east = points[:, 0] > np.median(points[:, 0])
    high = points[:, 2] > np.median(points[:, 2])
    tiles = [
        write_las(path.with_name(f"tile{i}.laz"), points[(east == a) & (high == b)])
        for i, (a, b) in enumerate([(0, 0), (0, 1), (1, 0), (1, 1)])
    ]
    in_file_order = numbers(*tiles)
    # A millimetre of a LAS file and that of a PLY file differ in the last bits.
    np.testing.assert_allclose(in_file_order[0], expected[0], rtol=1e-6)
    assert_same(numbers(*(tiles[i] for i in (2, 0, 3, 1))), in_file_order)


@pytest.mark.parametrize("threads", [1, 2])
def test_threads_change_nothing(whole: Tuple[Path, np.ndarray, np.ndarray], threads: int) -> None:
    path, _, expected = whole
    assert_same(numbers(path, threads=threads), expected)


def test_the_same_points_twice_change_nothing() -> None:
    points = points_of("torus, lying")
    once = volume_of(points).volume_m3
    assert volume_of(np.concatenate([points, points])).volume_m3 == pytest.approx(once, rel=0.002)


# --- where it lies, how it is turned, how large it is


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=4)
@given(shift=st.tuples(*[st.floats(-3e6, 3e6)] * 2, st.floats(-500, 5000)), angle=st.floats(0, 360))
def test_moving_and_turning_about_z(name: str, shift: Any, angle: float) -> None:
    turn = Rotation.from_euler("z", angle, degrees=True).as_matrix()
    moved = volume_of((points_of(name) - OFFSET) @ turn.T + OFFSET + shift)
    assert moved.volume_m3 == pytest.approx(local_result(name).volume_m3, rel=0.002)


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=4)
@given(factor=st.floats(-3, 3).map(lambda power: 10**power))
def test_scaling_by_s_gives_s_cubed(name: str, factor: float) -> None:
    one, other = local_result(name), volume_of((points_of(name) - OFFSET) * factor)
    assert other.volume_m3 == pytest.approx(one.volume_m3 * factor**3, rel=1e-6)
    assert other.std_m3 == pytest.approx(one.std_m3 * factor**3, rel=1e-4)


def test_scaling_where_surveys_are() -> None:
    """Coordinates of UTM round to a nanometre, which no volume may notice."""
    points = points_of("torus, lying")
    one, other = volume_of(points), volume_of((points - OFFSET) * 7.3 + OFFSET)
    assert other.volume_m3 == pytest.approx(one.volume_m3 * 7.3**3, rel=1e-6)


# --- slices


def test_the_number_of_levels_hardly_matters() -> None:
    sphere = scan(BODIES["sphere"](), 2_000, seed=1103)
    volumes = {n: volume_of(sphere, slices=n).volume_m3 for n in (10, 31, 100, 1000)}
    print(volumes)
    assert max(volumes.values()) / min(volumes.values()) - 1 < 0.003
    default = volume_of(sphere).volume_m3
    assert default == pytest.approx(volumes[1000], rel=0.002)


@pytest.mark.parametrize("name", [*NAMES, "cup", "two spheres"])
@pytest.mark.parametrize("slices", ["auto", 1, 7, 200])
def test_the_slices_sum_to_the_volume(name: str, slices: Any) -> None:
    result = volume_of(points_of(name), slices=slices)
    parts = result.slices
    assert sum(part.volume_m3 for part in parts) == pytest.approx(result.volume_m3, rel=1e-9)
    if slices != "auto":
        assert len(parts) == slices
    assert all(part.volume_m3 >= 0 for part in parts)
    assert np.all(np.diff([part.z_m for part in parts]) > 0)
    heights = sum(part.height_m for part in parts)
    assert heights == pytest.approx(result.max_height_m, rel=1e-6)
    for part in parts:
        assert part.volume_m3 == pytest.approx(part.area_m2 * part.height_m, rel=1e-6)


def test_each_slice_holds_its_part_of_a_sphere() -> None:
    sphere = scan(BODIES["sphere"](), 10_000, seed=1104)
    result = volume_of(sphere, slices=10)
    edges = np.linspace(-0.5, 0.5, 11)
    below = np.pi * (edges / 4 - edges**3 / 3)
    found = [part.volume_m3 for part in result.slices]
    np.testing.assert_allclose(found, np.diff(below), atol=0.0006)


def test_the_interval_is_that_of_the_standard_deviation_and_its_budget() -> None:
    result = volume_of(points_of("torus, lying"))
    assert result.std_m3 is not None
    assert result.std_m3 > 0
    squares = sum(item.std_m3**2 for item in result.budget)
    assert result.std_m3 == pytest.approx(squares**0.5, rel=1e-9)
