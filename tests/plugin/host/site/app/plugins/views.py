"""The plugin's addresses, matched in the order in which it names them."""

from django.http import Http404
from django.urls import re_path
from django.views.static import serve

from app.api.tasks import TaskNestedView as TaskView

from .functions import get_plugin_by_name

__all__ = ["TaskView", "api_view_handler", "app_view_handler"]


def _plugin(name):
    plugin = get_plugin_by_name(name, refresh_cache_if_none=True)
    if plugin is None:
        raise Http404("Plugin not found")
    return plugin


def api_view_handler(request, *args, plugin_name=None):
    """Answer below /api/plugins/NAME/."""
    for point in _plugin(plugin_name).api_mount_points():
        pattern = re_path(
            rf"^/api/plugins/{plugin_name}/{point.url}", point.view, *point.args, **point.kwargs
        )
        match = pattern.resolve(request.path)
        if match:
            return match.func(request, *match.args, **match.kwargs)
    raise Http404("No valid routes")


def app_view_handler(request, *args, plugin_name=None):
    """Serve the files under public."""
    plugin = _plugin(plugin_name)
    path = request.path[len(f"/plugins/{plugin_name}/") :]
    return serve(request, path, document_root=plugin.get_path("public"))
