"""Finding the one plugin."""

import importlib
import os
import sys

from django.conf import settings

if settings.MEDIA_ROOT not in sys.path:
    sys.path.append(settings.MEDIA_ROOT)

_found = {}


def get_plugin_by_name(name, only_active=True, refresh_cache_if_none=False):
    """Return a plugin; without refreshing one that came later is None."""
    if name not in _found and refresh_cache_if_none:
        _load(name)
    return _found.get(name)


def _load(name):
    if os.path.isfile(os.path.join(settings.MEDIA_ROOT, "plugins", name, "plugin.py")):
        _found[name] = importlib.import_module(f"plugins.{name}").Plugin()
