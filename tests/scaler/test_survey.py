"""From what a control file says to the network: order, units, and what nobody said."""

from __future__ import annotations

import math

import numpy as np
import pytest

from quantify_client.crs import local_frame
from quantify_client.scaler.adjustment.build import CloudPlace, build_network, reference_elevation
from quantify_client.scaler.control.model import CloudPosition, Control, ControlPoint, Length

SITE = local_frame("EPSG:32632", 691_000.0, 5_335_000.0, 520.0)


def control(points=(), lengths=(), cloud=()) -> Control:
    return Control(
        label="t",
        crs="EPSG:32632",
        height_m=None,
        points={point.name: point for point in points},
        lengths=list(lengths),
        cloud={place.name: place for place in cloud},
        picks=[],
        warnings=(),
    )


def point(name: str, east: float, north: float, *more: float) -> ControlPoint:
    return ControlPoint(name, 691_000.0 + east, 5_335_000.0 + north, *more)


def test_everything_said_is_taken() -> None:
    asked = control(
        [point("A", 0.0, 0.0, 0.5, 521.0, 0.02), point("B", 30.0, 40.0, 0.7)],
        [
            Length("A", "B", 50.2, 0.004, "B"),
            Length("B", "C", 2.0, 0.001, "B", bar=True),
            Length("A", "C", 49.0, 0.008, check=True),
        ],
    )
    place = CloudPlace(np.array([1.0, 2.0, 3.0]), np.diag([4.0, 5.0, 6.0]) * 1e-4)
    network, notes = build_network(asked, SITE, 520.0, {"D": place})
    assert notes == []
    assert network.names == ("A", "B", "D", "C")  # as they come: points, the cloud, lengths
    assert network.horizontal[0] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert np.isnan(network.horizontal[2:]).all()
    assert network.horizontal_sigma[:2].tolist() == [0.5, 0.7]
    assert network.elevation[0] == pytest.approx(1.0)
    assert np.isnan(network.elevation[1:]).all()
    assert network.elevation_sigma[0] == 0.02
    assert network.cloud[2].tolist() == [1.0, 2.0, 3.0]
    assert network.in_cloud.tolist() == [False, False, True, False]
    assert network.placed.tolist() == [True, True, False, False]
    assert network.levelled.tolist() == [True, False, False, False]
    assert network.cloud_covariance[2] == pytest.approx(place.covariance, abs=1e-11)
    assert network.ends.tolist() == [[0, 1], [1, 3], [0, 3]]
    assert network.length.tolist() == [50.2, 2.0, 49.0]
    assert network.length_sigma.tolist() == [0.004, 0.001, 0.008]
    assert network.bar.tolist() == [False, True, False]
    assert network.check.tolist() == [False, False, True]
    assert network.higher.tolist() == [1, -1, 0]
    assert network.used_lengths.tolist() == [0, 1]
    assert network.radius_m == SITE.radius_m


def test_defaults_are_used_and_told() -> None:
    asked = control(
        [point("A", 0.0, 0.0), point("B", 1.0, 0.0, None, 500.0), point("C", 2.0, 0.0, 0.2, 501.0)],
        [Length("A", "B", 3.0)],
    )
    network, notes = build_network(asked, SITE, 500.0, {})
    assert network.horizontal_sigma.tolist() == [3.0, 3.0, 0.2]
    assert network.elevation_sigma[1:].tolist() == [0.05, 0.05]
    assert network.length_sigma.tolist() == [0.01]
    assert notes == [
        "2 positions have no accuracy: 3 m (one sigma) is taken; give 'accuracy'",
        "2 elevations have no accuracy: 0.05 m (one sigma) is taken; give 'accuracy'",
        "1 distance has no accuracy: 0.01 m (one sigma) is taken; give 'accuracy'",
    ]


def test_sigma_of_nothing_is_not_believed() -> None:
    place = CloudPlace(np.zeros(3), np.zeros((3, 3)))
    asked = control([point("A", 0.0, 0.0, 0.0, 500.0, 0.0)], [Length("A", "B", 3.0, 0.0)])
    network, notes = build_network(asked, SITE, 500.0, {"A": place})
    assert notes == []
    assert network.horizontal_sigma[0] == network.elevation_sigma[0] == 1e-6
    assert network.length_sigma.tolist() == [1e-6]
    assert np.linalg.eigvalsh(network.cloud_covariance[0]) == pytest.approx([1e-12] * 3)


def test_elevations_count_from_the_level() -> None:
    points = [point("A", 0.0, 0.0, 1.0, 512.5, 0.1), point("B", 9.0, 0.0, 1.0, 507.5, 0.1)]
    asked = control([*points, point("C", 0.0, 9.0, 1.0)])
    assert reference_elevation(asked) == 510.0
    network, _ = build_network(asked, SITE, 510.0, {})
    assert network.elevation == pytest.approx([2.5, -2.5, math.nan], nan_ok=True)


def test_no_elevation_has_no_mean() -> None:
    assert reference_elevation(control([point("A", 0.0, 0.0)])) is None


def test_positions_are_at_the_height_of_the_origin() -> None:
    """What a point's own height adds to its position is in the equations: not here as well."""
    low, high = (
        build_network(control([point("A", 300.0, 400.0, 1.0, z, 0.1)]), SITE, 520.0, {})[0]
        for z in (520.0, 900.0)
    )
    assert low.horizontal.tolist() == high.horizontal.tolist()
    # The zone is 0.9996 true on its middle, 191 km from here it is 1.00005; and 520 m up.
    ground = float(np.linalg.norm(low.horizontal[0]))
    assert ground == pytest.approx(500.0 * (1 + 520.0 / 6.38e6) / 1.00005, rel=1e-5)


def test_without_positions_the_earth_is_a_plane() -> None:
    places = {name: CloudPlace(np.arange(3.0) + i, np.eye(3)) for i, name in enumerate("AB")}
    asked = control([], [Length("B", "A", 2.0, 0.01, bar=True)], [CloudPosition("A", (0, 0, 0))])
    network, notes = build_network(asked, None, 0.0, places)
    assert notes == []
    assert network.names == ("A", "B")
    assert network.ends.tolist() == [[1, 0]]
    assert math.isinf(network.radius_m)
    assert not network.placed.any()


def test_nothing_at_all() -> None:
    network, notes = build_network(control(), None, 0.0, {})
    assert (network.names, notes) == ((), [])
    assert network.ends.shape == (0, 2)
    assert network.used_lengths.tolist() == []
