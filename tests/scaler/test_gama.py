"""The adjustment against GNU Gama, an independent program for geodetic networks."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import gama
import numpy as np
import pytest

from quantify_client.scaler.adjustment.elevations import Elevations, solve_elevations

GAMA = os.environ.get("GAMA_LOCAL") or shutil.which("gama-local")


@pytest.fixture(scope="module")
def solved() -> Elevations:
    return solve_elevations(gama.network())


def test_places_are_those_of_gama(solved: Elevations) -> None:
    assert solved.points == pytest.approx(gama.RECORDED, abs=1e-4, rel=0)


def test_standard_deviations_are_those_of_gama(solved: Elevations) -> None:
    assert solved.std == pytest.approx(gama.RECORDED_STD, rel=1e-3)


@pytest.mark.skipif(GAMA is None, reason="gama-local is not installed (nor named by GAMA_LOCAL)")
def test_gama_says_the_same_today(solved: Elevations, tmp_path: Path) -> None:
    off = np.random.default_rng(5).normal(0.0, 0.05, solved.points.shape)
    points, std = gama.run(str(GAMA), tmp_path, dict(zip(gama.POSITIONS, solved.points + off)))
    assert solved.points == pytest.approx(points, abs=1e-4, rel=0)
    assert solved.std == pytest.approx(std, rel=1e-3)
    assert points == pytest.approx(gama.RECORDED, abs=1e-4, rel=0)
    assert std == pytest.approx(gama.RECORDED_STD, rel=1e-3)
