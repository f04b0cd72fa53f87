"""What benchmarks/coverage.py says of its ground, its truths and its scores is so."""

from __future__ import annotations

import doctest
import importlib.util
import math
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Callable

import numpy as np
import pytest
import shapely
from scipy import special
from shapely.geometry import MultiPolygon, Point, Polygon, box
from terrains import integral as midpoint_integral

from quantify_client.volcalc.terrain.base import BASES

# At the end: a package of the same name as a benchmark goes first.
BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"
sys.path.append(str(BENCHMARKS))
grounds, known_kriging, scores, sites, surveys = map(
    import_module, ("grounds", "known_kriging", "scores", "sites", "surveys")
)

pytestmark = pytest.mark.one_python

WIDTH = 300.0


@pytest.fixture(scope="module")
def coverage() -> ModuleType:
    """Return the benchmark, which the package of that name hides."""
    spec = importlib.util.spec_from_file_location("coverage_benchmark", BENCHMARKS / "coverage.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def sampled(height: Callable[..., np.ndarray]) -> np.ndarray:
    """Return heights every metre over the site."""
    line = np.arange(-WIDTH / 2, WIDTH / 2)
    return height(*np.meshgrid(line, line))


# --- ground


@pytest.mark.parametrize("wavelength", [6.0, 12.0])
@pytest.mark.parametrize("name", list(grounds.RELIEFS))
def test_relief_has_variance_one(name: str, wavelength: float) -> None:
    fields = [
        sampled(grounds.RELIEFS[name](np.random.default_rng(seed), WIDTH, wavelength))
        for seed in range(10)
    ]
    # Waves in nearly the same direction interfere over all of a site: one field tells little.
    assert np.mean(np.square(fields)) == pytest.approx(1.0, abs=0.08)


@pytest.mark.parametrize("smoothness", [0.5, 1.5, 2.5, math.inf])
def test_covariance_of_a_field_is_that_of_its_spectrum(smoothness: float) -> None:
    wavelength = 20.0
    lags = np.array([0, 2, 5, 10])
    found = np.zeros(len(lags))
    for seed in range(8):
        rng = np.random.default_rng(seed)
        z = sampled(grounds.gaussian_field(rng, grounds.matern(smoothness), WIDTH, wavelength))
        found += [np.mean(z[:, : 300 - lag] * z[:, lag:]) / 8 for lag in lags]
    # The Matern function by Bessel functions, Rasmussen & Williams 2006, eq. 4.14.
    length = wavelength / 4.4429
    expected = np.exp(-((lags / length) ** 2) / 2)
    if math.isfinite(smoothness):
        d = np.maximum(np.sqrt(2 * smoothness) * lags / length, 1e-9)
        bessel = special.kv(smoothness, d) * d**smoothness
        expected = bessel * 2 ** (1 - smoothness) / special.gamma(smoothness)
    assert found == pytest.approx(expected, abs=0.05)
    assert known_kriging.covariance(lags, smoothness, length) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("name", list(grounds.RELIEFS))
def test_power_for_each_octave_is_largest_at_the_wavelength(name: str) -> None:
    wavelength = 16.0
    line = np.arange(-WIDTH / 2, WIDTH / 2)
    k = 2 * np.pi * np.hypot(*np.meshgrid(np.fft.fftfreq(len(line)), np.fft.fftfreq(len(line))))
    octave = np.round(np.log2(2 * np.pi / np.where(k > 0, k, np.nan) / wavelength))
    taper = np.outer(np.hanning(len(line)), np.hanning(len(line)))
    power = np.zeros(k.shape)
    for seed in range(8):
        field = grounds.RELIEFS[name](np.random.default_rng(seed), WIDTH, wavelength)
        power += np.abs(np.fft.fft2(sampled(field) * taper)) ** 2
    each = {int(n): power[octave == n].sum() for n in range(-2, 4)}
    # A power law has nothing above its longest wave, and as much or more in the octave below it.
    best = max(each, key=each.get)
    assert best in ((-1, 0) if name == "fractal" else (0,))
    assert each[2] + each[3] < 0.15 * sum(each.values())


# --- truths


def test_volume_of_a_pyramid() -> None:
    # A square of 18 m2 on its corner, 2 m high: 18 * 2 / 3.
    diamond = sites.Star(1.0, -2.0, np.full(4, 3.0))
    pile = sites.Pile(diamond, 1.0, 2.0)
    assert diamond.polygon.area == pytest.approx(18.0)
    assert pile.volume == pytest.approx(12.0)
    assert sites.integral(pile, diamond.polygon) == pytest.approx(12.0, rel=1e-5)
    # The half of it that lies west of its middle.
    assert sites.integral(pile, box(-5, -8, 1, 4)) == pytest.approx(6.0, rel=1e-5)


def test_integral_of_a_slope_over_a_triangle() -> None:
    # x over the half of a unit square: 1 / 6; ten lines miss 1 / 400 of it.
    triangle = Polygon([(0, 0), (1, 0), (0, 1)])
    assert sites.integral(lambda x, y: x, triangle, 10) == pytest.approx(1 / 6, rel=0.003)
    around = MultiPolygon([triangle, box(2, 0, 3, 1).difference(box(2.2, 0.2, 2.8, 0.8))])
    assert sites.integral(lambda x, y: x + 0 * y, around) == pytest.approx(1 / 6 + 1.6, rel=1e-3)


def test_volume_of_a_cone() -> None:
    # pi r^2 h / 3 = 6 pi; that over 720 corners is smaller by 1e-5.
    pile = sites.Pile(sites.Star(0, 0, np.full(720, 3.0)), 1.0, 2.0)
    assert pile.volume == pytest.approx(6 * np.pi, rel=3e-5)
    assert sites.integral(pile, Point(0, 0).buffer(4)) == pytest.approx(6 * np.pi, rel=3e-5)
    assert pile(np.array([1.5]), np.array([0.0])) == pytest.approx(1.0)


@pytest.mark.parametrize("flat", [0.0, 0.4])
@pytest.mark.parametrize("round_", [0.0, 0.7, 1.0])
def test_fullness_of_a_profile(flat: float, round_: float) -> None:
    profile = sites.Profile(flat, round_)
    gauge = (np.arange(100_000) + 0.5) / 100_000
    assert profile.fullness == pytest.approx(np.mean(2 * gauge * profile(gauge)), rel=1e-6)
    assert sites.Profile(0.0, 1.0).fullness == pytest.approx(0.5)  # a paraboloid


@pytest.mark.parametrize("meander", [0.0, 3.0])
def test_volume_of_a_gully(meander: float) -> None:
    # A V of 2 m x 1 m is 1 m2; winding to the side changes no area. 10 m of it lie in the outline.
    gully = sites.Gully(2.0, 1.0, meander, 8.0, 0.3)
    assert sites.integral(gully, box(-5, -4, 5, 6)) == pytest.approx(-10.0, rel=1e-5)
    # Half a sine over 9 m: 2 / pi of that length.
    ending = sites.Gully(2.0, 1.0, meander, 8.0, 0.3, length=9.0)
    assert sites.integral(ending, box(-5, -5, 5, 5)) == pytest.approx(-18 / np.pi, rel=1e-4)


@pytest.mark.parametrize("name", list(surveys.CLASSES))
def test_truths_are_the_integrals_of_the_forms(name: str) -> None:
    for number in range(4):
        rng = surveys.generator(name, number)
        kind = surveys.CLASSES[name]
        site = kind.site(rng, surveys.log_uniform(rng, kind.width))
        assert site.outline.is_valid
        by_midpoints = midpoint_integral(site.form, site.outline, np.sqrt(site.outline.area) / 400)
        assert site.truth == pytest.approx(by_midpoints, rel=3e-3, abs=1e-9)


@pytest.mark.parametrize("name", ["relief-0.1", "neighbours", "gullies"])
def test_a_survey_can_be_had_again_and_goes_around_its_outline(name: str) -> None:
    one, again, other = (surveys.make_survey(name, number) for number in (3, 3, 4))
    assert np.array_equal(one.points, again.points)
    assert one.truth == again.truth != other.truth
    assert shapely.MultiPoint(one.points[:2].T[::10]).convex_hull.contains(one.outline)
    assert one.outline.bounds[0] > 500_000


# --- scores


def test_doctests_of_the_scores() -> None:
    assert doctest.testmod(scores).failed == 0


@pytest.mark.parametrize(
    ("stated", "held", "score"),
    # Of a standard normal error: P(|e| < 1.96 s), and the interval score
    # 2 c + (4 / 0.05) (phi(c) - c Phi(-c)) at c = 1.96 s, over that at s = 1: 4.6756.
    [(1.0, 95.0, 1.0), (0.5, 67.29, 1.8999), (2.0, 99.991, 1.6769)],
)
def test_scores_of_normal_errors(stated: float, held: float, score: float) -> None:
    error = np.random.default_rng(5).standard_normal(200_000)
    std, half = np.full(len(error), stated), np.full(len(error), stated * scores.Z95)
    found = scores.scores(error, std, error - half, error + half, np.ones(len(error)), [False] * 9)
    assert found.coverage_percent == pytest.approx(held, abs=0.15)
    assert found.rms_z == pytest.approx(1 / stated, rel=0.01)
    assert found.score_ratio == pytest.approx(score, rel=0.02)
    assert found.failures() == ([] if stated == 1.0 else found.failures())
    assert ("rms_z" in found.failures()) == (stated != 1.0)


def test_thirds_are_by_half_width() -> None:
    error, std = np.array([3.0, 2.0, 1.0, 3.0, 2.0, 1.0]), np.array([3.0, 2.0, 1.0] * 2)
    error[std == 1.0] = 5.0
    half = std * scores.Z95
    found = scores.scores(error, std, error - half, error + half, np.ones(6), [True] + [False] * 5)
    assert (found.rms_z_narrow, found.rms_z_middle, found.rms_z_wide) == (5.0, 1.0, 1.0)
    assert found.lost_percent == pytest.approx(100 / 6)


# --- the known kriging


def test_kriging_gives_back_a_plane() -> None:
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-20, 20, (2, 20_000))
    outline = sites.star(rng, 6.0, 1.0, 2.0).polygon
    points = np.stack([x, y, 0.2 * x - 0.1 * y + 7.0])
    blocks = known_kriging.block_means(points, outline, 3.0)
    assert 100 < len(blocks.x) < 500
    outside = ~shapely.contains_xy(outline, x, y)
    assert blocks.count.sum() == np.count_nonzero(outside)
    mean, _ = known_kriging.kriged_mean(blocks, known_kriging.nodes_within(outline), 1.5, 3.0, 0.01)
    middle = outline.centroid
    assert mean == pytest.approx(0.2 * middle.x - 0.1 * middle.y + 7.0, abs=1e-6)


@pytest.mark.parametrize(("kind", "wavelength"), [("exponential", 12.0), ("matern-5/2", 25.0)])
def test_errors_of_known_kriging_are_as_large_as_it_says(kind: str, wavelength: float) -> None:
    smoothness, length = known_kriging.SMOOTHNESS[kind], wavelength / grounds.WAVELENGTH
    z = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        x, y = rng.uniform(-12, 12, (2, 2_600))
        outline = sites.star(rng, 6.0).polygon
        field = grounds.gaussian_field(rng, grounds.matern(smoothness), 30.0, wavelength)
        heights = known_kriging.RELIEF * field(x, y) + rng.normal(0, 0.01, len(x))
        blocks = known_kriging.block_means(np.stack([x, y, heights]), outline, length)
        nodes = known_kriging.nodes_within(outline)
        mean, std = known_kriging.kriged_mean(blocks, nodes, smoothness, length, 0.01)
        truth = known_kriging.RELIEF * sites.integral(field, outline, 200) / outline.area
        z.append((mean - truth) / std)
    # 40 surveys tell it to 11 %.
    assert 0.7 < scores.rms(np.array(z)) < 1.35


# --- the whole


def test_each_survey_has_a_row_for_each_base(coverage: ModuleType) -> None:
    rows = coverage.rows_of(("relief-0", 1, 0, BASES))
    assert [row["base"] for row in rows] == list(BASES)
    assert all(row["refused"] is None for row in rows)
    plane = rows[BASES.index("plane")]
    assert plane["low_m3"] < plane["volume_m3"] < plane["high_m3"]
    assert abs(plane["volume_m3"] - plane["truth_m3"]) < 6 * plane["std_m3"]


def test_what_cannot_be_measured_is_refused(coverage: ModuleType) -> None:
    found, why = coverage.on_bases(np.full((3, 10), 1e3), box(0, 0, 10, 10), BASES)
    assert found == {}
    assert why.startswith("SupportError: ")
