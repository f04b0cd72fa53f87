"""The versions that CI tests with: names and versions only, WebODM's own for Python 3.9."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
RELEASE = re.compile(r"([A-Za-z0-9][A-Za-z0-9._-]*)==([0-9][0-9A-Za-z.!]*)")
PINS = {
    "numpy": "1.26.2",
    "scipy": "1.11.3",
    "Django": "2.2.27",
    "djangorestframework": "3.13.1",
}


def locked(python: str) -> dict:
    head, *lines = (ROOT / ".ci" / f"constraints-{python}.txt").read_text("utf-8").splitlines()
    assert head.startswith("# Written by 'make lock'")
    releases = [RELEASE.fullmatch(line) for line in lines]
    assert all(releases), "an address, a folder or a range got in"
    return dict(release.groups() for release in releases)


@pytest.mark.parametrize("python", ["3.9", "3.13"])
def test_a_lock_holds_one_version_of_each_package_and_nothing_else(python):
    found = locked(python)
    assert {"numpy", "laspy", "pyproj", "PyYAML", "pytest", "mypy", "ruff"} <= found.keys()


def test_python_39_has_what_webodm_runs():
    found = locked("3.9")
    assert {name: found[name] for name in PINS} == PINS
    made_with = re.search(r"^OLD_PINS := (.*)$", (ROOT / "Makefile").read_text("utf-8"), re.M)
    assert made_with.group(1).split() == [f"{name}=={pin}" for name, pin in PINS.items()]
