"""The REST API below /api/plugins/volcalc/, see docs/webodm.md: a task, and a project's series.

The views on jobs are in `job_views`, those on saved measurements in `saved_views`.
"""

import os

from ..files.inputs import LIMITS
from ..files.list_rows import Budget, TooLargeError, UnreadError, entry_of
from ..files.store import UnreadableError, saved_paths
from ..files.untrusted_json import MisshapenError
from ..quantify_client.options import BASES, METHOD_REVISION
from . import database
from .base import VolumeView, jobs_root, may_change, may_view_project, plugin_here
from .listing import own_rows
from .starting import crop_of, has_crs, reason_not, sources_of

__all__ = ["Overview", "Series"]


class Overview(VolumeView):
    """What the panel has to know to begin."""

    def get(self, request, pk=None):
        """Return the task, what can be done with it, and the limits."""
        task = self.task(request, pk)
        change = may_change(request, task)
        reason = reason_not(task) or (
            None if change else "You may look at saved measurements, and not make new ones."
        )
        sources = sources_of(task)
        plugin = plugin_here()
        present = [saved for saved, *_ in saved_paths(task)]
        extent = task.get_extent()
        self.sweep()
        return self.answer(
            {
                "task": {
                    "id": str(task.id),
                    "name": task.name,
                    "project": task.project.pk,
                    "epsg": task.epsg,
                },
                "can_change": change,
                "can_run": reason is None,
                "reason": reason,
                "sources": {kind: path is not None for kind, path in sources.items()},
                "has_crs": has_crs(task, sources),
                "crop": crop_of(task),
                "extent": None if extent is None else [float(value) for value in extent],
                "points": _points_of(task),
                "has_cameras": os.path.isfile(task.assets_path("odm_report", "shots.geojson")),
                "lost": database.were_lost(plugin, task, present),
                "jobs": own_rows(jobs_root(), task, request.user),
                "limits": LIMITS,
                "bases": BASES,
                "method_revision": METHOD_REVISION,
                "version": plugin.get_manifest()["version"],
            }
        )


def _points_of(task):
    """Return the number of points by the task's statistics, which an imported all.zip brings."""
    try:
        points = task.get_statistics()["pointcloud"]["points"]
    except Exception:
        # WebODM reads this file without checking it.
        return None
    return points if isinstance(points, int) and 0 <= points < 10**15 else None


class Series(VolumeView):
    """The project's tasks over time, by the areas that their measurements share."""

    _MOST_TASKS, _MOST_ROWS = 100, 500

    def get(self, request, pk=None):
        """Return the areas of this task's project and what was measured in each.

        With it the number of those that the next request will tell (`unread`), and of those that
        cannot be told of here (`left_out`).
        """
        task = self.task(request, pk)
        whole = may_view_project(request, task.project)
        series, rows, budget, unread, left_out = {}, 0, Budget(), 0, 0
        for other in self._tasks(task):
            if not (whole or other.public) or rows >= self._MOST_ROWS:
                continue
            for saved, path, _ in saved_paths(other)[: self._MOST_ROWS - rows]:
                rows += 1
                try:
                    entry = entry_of(path, saved, budget)
                except UnreadError:
                    unread += 1
                    continue
                except (UnreadableError, MisshapenError, TooLargeError):
                    left_out += 1
                    continue
                key = entry["area_key"]
                group = {"area_key": key, "name": entry["name"], "rows": []}
                series.setdefault(key, group)["rows"].append(self._row(other, saved, entry))
        return self.answer({"areas": list(series.values()), "unread": unread, "left_out": left_out})

    def _tasks(self, task):
        found = self.queryset.filter(project=task.project).order_by("created_at")
        return found[: self._MOST_TASKS]

    @staticmethod
    def _row(task, saved, entry):
        keys = ("volume_m3", "cut_m3", "fill_m3", "std_m3", "shape", "base", "comparable")
        return {
            "task": str(task.id),
            "task_name": task.name,
            "date": task.created_at.isoformat(),
            "measurement": saved,
            **{key: entry["summary"][key] for key in keys},
        }
