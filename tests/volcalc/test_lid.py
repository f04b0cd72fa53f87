"""The lid under a body whose foot has no area, or reaches absurdly far."""

import numpy as np

from quantify_client.volcalc.body.floor import lid


def test_a_foot_that_is_a_line_gets_no_lid():
    along = np.linspace(0.0, 5e7, 9)
    points = np.column_stack([along, 1.28 * along, np.zeros(9)])
    assert len(lid(points, 0.0, 1.0, 1e-3)) == 0


def test_a_stray_does_not_make_a_lid_larger_than_memory():
    generator = np.random.default_rng(1)
    points = np.vstack([generator.uniform(0, 1, (600, 3)), [[1e6, 1e6, 0.0], [1e6, 0.0, 0.0]]])
    assert len(lid(points, 0.0, 1.0, 0.05)) < 5_000_000
