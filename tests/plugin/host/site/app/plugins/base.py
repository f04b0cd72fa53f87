"""The base class of plugins, with what ours uses of it."""

import json
import os
import sys
from contextlib import contextmanager

from django.conf import settings

from app.models import PluginDatum


class MountPoint:
    """An address and its view."""

    def __init__(self, url, view, *args, **kwargs):
        self.url, self.view, self.args, self.kwargs = url, view, args, kwargs


class _Store:
    def __init__(self, namespace):
        self.namespace = namespace

    def get_json(self, key, default=None):
        """Return a value."""
        row = PluginDatum.objects.filter(key=f"{self.namespace}::{key}", user=None).first()
        return default if row is None else json.loads(row.json_text)

    def set_json(self, key, value):
        """Keep a value."""
        PluginDatum.objects.update_or_create(
            key=f"{self.namespace}::{key}", user=None, defaults={"json_text": json.dumps(value)}
        )


class PluginBase:
    """A plugin in a folder of the media folder."""

    def __init__(self):
        self.name = self.__class__.__module__.split(".")[-2]

    def get_name(self):
        """Return the name of the folder."""
        return self.name

    def get_path(self, *paths):
        """Return the plugin's folder, or a place in it."""
        module = sys.modules[self.__class__.__module__]
        return os.path.join(os.path.dirname(module.__file__), *paths)

    def path_exists(self, path):
        """Whether there is such a file in the plugin's folder."""
        return os.path.exists(self.get_path(path))

    def get_persistent_path(self, *paths):
        """Return the same folder: deleting a plugin takes it away."""
        return os.path.join(settings.MEDIA_ROOT, "plugins", self.name, *paths)

    @contextmanager
    def python_imports(self):
        """Make the packages of requirements.txt importable."""
        folder = self.get_persistent_path("site-packages")
        sys.path.insert(0, folder)
        try:
            yield
        finally:
            sys.path.remove(folder)

    def get_global_data_store(self):
        """Return what is kept for all users."""
        return _Store(self.name)

    def get_manifest(self):
        """Return the parsed manifest.json."""
        with open(self.get_path("manifest.json"), encoding="utf-8") as file:
            return json.load(file)

    def api_mount_points(self):
        """Return the addresses of the API."""
        return []

    def serve_public_assets(self, request):
        """Whether a visitor gets the files under public."""
        return True
