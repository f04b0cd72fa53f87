"""A control file that is right, and what tests of reading one share."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from quantify_client.errors import ControlError
from quantify_client.scaler.control.read import read_control

EXAMPLE = """\
crs: EPSG:4326
unit: m
height: 12
points:
  A: {lat: 34.40829882, lon: -119.87999210, accuracy: 3.0}
  B: {lat: 34.40834272, lon: -119.87995661, accuracy: 3.0, elevation: 12.4,
      elevation_accuracy: 0.02}
distances:
  - {from: A, to: B, length: 5.879, accuracy: 0.005, higher: B}
  - {from: A, to: P, length: 41.20, accuracy: 0.01, check: true}
cloud:
  A: {xyz: [235281.02, 3811195.11, 11.93], accuracy: 0.02}
  P: {xyz: [235270.10, 3811201.50, 11.20]}
  Q: {xyz: [235272.02, 3811201.95, 11.31]}
scale_bars:
  - {from: P, to: Q, length: 2.000, accuracy: 0.001}
"""
GCP_LIST = "EPSG:32611\n235281.01 3811195.14 12.5 730.5 1019.9 IMG_0031.jpg B\n"


def control(folder: Path, text: str, name: str = "control.yaml"):
    (folder / name).write_text(text, encoding="utf-8")
    return read_control(folder / name)


def refusal(folder: Path, text: str, name: str = "control.yaml") -> str:
    with pytest.raises(ControlError) as caught:
        control(folder, text, name)
    return one_line(caught.value)


def one_line(error: ControlError) -> str:
    message = str(error)
    assert len(message.splitlines()) == 1
    assert message.isprintable()
    assert 20 <= len(message) <= 500
    return message


def as_json() -> str:
    return json.dumps(
        {
            "crs": "EPSG:4326",
            "unit": "m",
            "height": 12,
            "points": {
                "A": {"lat": 34.40829882, "lon": "-119.87999210", "accuracy": 3.0},
                "B": {
                    **{"lat": 34.40834272, "lon": -119.87995661, "accuracy": 3},
                    **{"elevation": 12.4, "elevation_accuracy": 2e-2},
                },
            },
            "distances": [
                {"from": "A", "to": "B", "length": 5.879, "accuracy": 0.005, "higher": "B"},
                {"from": "A", "to": "P", "length": 41.2, "accuracy": 0.01, "check": True},
            ],
            "cloud": {
                "A": {"xyz": [235281.02, 3811195.11, 11.93], "accuracy": 0.02},
                "P": {"xyz": [235270.1, 3811201.5, 11.2], "accuracy": None},
                "Q": {"xyz": [235272.02, 3811201.95, "11.31"]},
            },
            "images": None,
            "scale_bars": [{"from": "P", "to": "Q", "length": 2.0, "accuracy": 0.001}],
        }
    )
