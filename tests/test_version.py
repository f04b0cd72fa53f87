"""What the package knows of its own installation."""

from __future__ import annotations

import json
import shlex
import sys
from importlib import metadata

import pytest

from quantify_client import version


class Installed:
    """Stands in for what pip records of an installation."""

    def __init__(self, url):
        self.url = url

    def read_text(self, name):
        assert name == "direct_url.json"
        return None if self.url is None else json.dumps({"url": self.url, "dir_info": {}})


@pytest.fixture
def installed_from(monkeypatch):
    def installed(url):
        monkeypatch.setattr(metadata, "distribution", lambda name: Installed(url))

    return installed


def test_an_extra_is_added_from_the_checkout(installed_from, tmp_path):
    checkout = tmp_path / "my checkout"
    checkout.mkdir()
    (checkout / "pyproject.toml").touch()
    installed_from(checkout.as_uri())
    command = shlex.split(version.how_to_add("vector"))
    assert command == [sys.executable, "-m", "pip", "install", f"{checkout}[vector]"]


@pytest.mark.parametrize("url", [None, "file:///nowhere/at/all", "https://127.0.0.1/x.git", "["])
def test_without_a_checkout_at_hand_it_is_named_in_words(installed_from, url):
    installed_from(url)
    words, command = version.how_to_add("vector").split(": ")
    assert "checkout" in words
    assert shlex.split(command)[1:] == ["-m", "pip", "install", ".[vector]"]


def test_a_copy_that_was_never_installed(monkeypatch):
    def missing(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "distribution", missing)
    assert "in the checkout" in version.how_to_add("vector")
