"""The REST API below /api/plugins/volcalc/: see docs/webodm.md."""

import contextlib
import importlib
import os

from django.http import HttpResponse
from rest_framework import exceptions

from . import records
from .base import VolumeView, may_change, may_view_project, plugin_here, refused
from .checks import LIMITS, checked_control, checked_name, checked_options
from .documents import UnreadableError, checked_document, entry_of, read_document
from .shapes import MisshapenError
from .starting import area_of, crop_of, reason_not, sources_of, start
from .store import (
    MOST_SAVED,
    is_id,
    one_at_a_time,
    read_capped,
    saved_folder,
    saved_path,
    saved_paths,
    user_jobs,
)
from .store import write_json as write

__all__ = [
    "Again",
    "Export",
    "JobResult",
    "Jobs",
    "Measurements",
    "OneJob",
    "OneMeasurement",
    "Overview",
    "Series",
]


_TYPES = {"csv": "text/csv", "geojson": "application/geo+json", "html": "text/html"}


def _read(task, saved):
    """Return a saved measurement, or say that there is none or what is wrong with it."""
    if not is_id(saved):
        raise exceptions.NotFound("there is no such measurement")
    try:
        return read_document(saved_path(task, saved), saved, task)
    except UnreadableError:
        raise exceptions.NotFound("there is no such measurement") from None
    except MisshapenError as error:
        raise refused(422, f"the file of this measurement is damaged: {error}") from None


@contextlib.contextmanager
def _changing(task):
    """Change what a task has saved, one request at a time; its size is told to WebODM."""
    plugin = plugin_here()
    with one_at_a_time(plugin.get_persistent_path("jobs")):
        try:
            yield plugin
        except OSError as error:
            words = f"WebODM cannot write among the task's files ({error.strerror})"
            raise refused(507, f"{words}; free some space, or ask its administrator") from error
        # The size alone: everything else of the task may have changed since it was read.
        task.update_size()
        type(task).objects.filter(pk=task.pk).update(size=task.size)


def _shown(request, document, names):
    """Return a document with its author, whom anonymous visitors do not see."""
    user = names.get(document["id"]) if request.user.is_authenticated else None
    return {**document, "user": user}


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
        present = [saved for saved, _ in saved_paths(task)]
        extent = task.get_extent()
        points = ((task.get_statistics() or {}).get("pointcloud") or {}).get("points")
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
                "has_crs": bool(task.epsg or task.wkt),
                "crop": crop_of(task),
                "extent": None if extent is None else [float(value) for value in extent],
                "points": points if isinstance(points, int) else None,
                "has_cameras": os.path.isfile(task.assets_path("odm_report", "shots.geojson")),
                "lost": records.were_lost(plugin, task, present),
                "jobs": self._own_jobs(request, task, plugin),
                "limits": LIMITS,
                "version": plugin.get_manifest()["version"],
            }
        )

    @staticmethod
    def _own_jobs(request, task, plugin):
        """Return the visitor's jobs on this task that go on, so that a reload finds them again."""
        if not request.user.is_authenticated:
            return []
        folders = user_jobs(plugin.get_persistent_path("jobs"), request.user.pk)
        return [f.state() for f in folders if (f.about() or {}).get("task") == str(task.id)]


class Jobs(VolumeView):
    """Measurements under way."""

    def post(self, request, pk=None):
        """Start one."""
        task = self.task(request, pk, change=True)
        asked = self.body(request, "area", "options", "control", "name")
        folder = start(
            request,
            task,
            area=area_of(task, asked.get("area")),
            options=checked_options(asked.get("options")),
            control=checked_control(asked.get("control")),
            name=checked_name(asked.get("name") or "Volume"),
        )
        return self.answer({"job": folder.job, "state": folder.state()["state"]}, 202)


class OneJob(VolumeView):
    """One measurement under way."""

    def get(self, request, pk=None, job=None):
        """Say how it goes."""
        return self.answer(self.job(request, self.task(request, pk), job).state())

    def delete(self, request, pk=None, job=None):
        """End it; one that has ended already stays as it is."""
        task = self.task(request, pk)
        folder = self.job(request, task, job)
        if folder.state()["state"] in ("queued", "running", "lost"):
            folder.cancel()
            self._stop(folder)
        return self.answer({"job": job, "state": folder.state()["state"]})

    @staticmethod
    def _stop(folder):
        """Have the worker give up: the marker alone is seen only between two chunks of points."""
        from worker.celery import app

        try:
            celery = read_capped(folder.path / "celery", 200).decode()
        except UnreadableError:
            return  # not even queued yet: the marker is enough
        app.control.revoke(celery, terminate=True)


class JobResult(VolumeView):
    """What a measurement came to."""

    def get(self, request, pk=None, job=None):
        """Return the document, or 409 with the state."""
        folder = self.job(request, self.task(request, pk), job)
        state = folder.state()["state"]
        document = folder.result() if state == "done" else None
        if document is None:
            return self.answer({"error": f"the measurement is {state}", "state": state}, 409)
        return self.answer({**document, "user": (folder.about() or {}).get("user_name")})


class Measurements(VolumeView):
    """The saved measurements of a task."""

    def get(self, request, pk=None):
        """List them, the oldest first; one that cannot be read is listed as such."""
        task = self.task(request, pk)
        names = records.names(plugin_here(), task)
        return self.answer(
            [self._row(request, saved, path, names) for saved, path in saved_paths(task)]
        )

    @staticmethod
    def _row(request, saved, path, names):
        row = dict.fromkeys(("name", "date", "user", "summary", "options", "problem"))
        try:
            row.update(entry_of(path, saved))
        except (UnreadableError, MisshapenError) as error:
            return {**row, "id": saved, "readable": False, "problem": str(error)[:300]}
        del row["area_key"]
        user = names.get(saved) if request.user.is_authenticated else None
        return {**row, "id": saved, "user": user, "readable": True}

    def post(self, request, pk=None):
        """Keep the result of a job among the task's assets."""
        task = self.task(request, pk, change=True)
        asked = self.body(request, "job", "name")
        folder = self.job(request, task, asked.get("job"))
        document = folder.result() if folder.state()["state"] == "done" else None
        if document is None:
            raise refused(409, "the measurement is not done; wait for it, then save it")
        if asked.get("name") is not None:
            document["name"] = checked_name(asked["name"])
        # Checked before it is written: what is kept can be read again.
        document = checked_document(document)
        user = (folder.about() or {}).get("user_name")
        with _changing(task) as plugin:
            present = {saved for saved, _ in saved_paths(task)}
            if document["id"] not in present and len(present) >= MOST_SAVED:
                raise refused(409, f"the task has {MOST_SAVED} measurements; delete one first")
            saved_folder(task).mkdir(parents=True, exist_ok=True)
            write(saved_path(task, document["id"]), document)
            records.remember(plugin, task, document["id"], user)
        return self.answer({**document, "user": user}, 201)


class OneMeasurement(VolumeView):
    """One saved measurement."""

    def get(self, request, pk=None, saved=None):
        """Return the document."""
        task = self.task(request, pk)
        return self.answer(_shown(request, _read(task, saved), records.names(plugin_here(), task)))

    def patch(self, request, pk=None, saved=None):
        """Give it another name."""
        task = self.task(request, pk, change=True)
        asked = self.body(request, "name")
        name = checked_name(asked.get("name"))
        with _changing(task):
            document = {**_read(task, saved), "name": name}
            write(saved_path(task, saved), document)
        return self.answer(_shown(request, document, records.names(plugin_here(), task)))

    def delete(self, request, pk=None, saved=None):
        """Remove it; also one that cannot be read."""
        task = self.task(request, pk, change=True)
        path = saved_path(task, saved) if is_id(saved) else None
        with _changing(task) as plugin:
            try:
                if path is None:
                    raise FileNotFoundError
                path.unlink()
            except FileNotFoundError:
                raise exceptions.NotFound("there is no such measurement") from None
            records.forget(plugin, task, saved)
        return HttpResponse(status=204)


class Export(VolumeView):
    """A saved measurement as a file for other programs, or for people."""

    def get(self, request, pk=None, saved=None):
        """Send it to be kept: made on request, never stored where WebODM would show it inline."""
        task = self.task(request, pk)
        kind = request.GET.get("format", "")
        units = request.GET.get("units", "metric")
        if kind not in _TYPES or units not in ("metric", "us"):
            raise MisshapenError("give format=csv, geojson or html, and units=metric or us")
        document = _shown(request, _read(task, saved), records.names(plugin_here(), task))
        pages = importlib.import_module(f"{__package__}.quantify_client.report.saved")
        text = pages.exported(document, kind, units)
        response = HttpResponse(
            text.encode("utf-8", "replace"), content_type=f"{_TYPES[kind]}; charset=utf-8"
        )
        name = pages.file_name(document["name"])
        response["Content-Disposition"] = f'attachment; filename="{name}.{kind}"'
        response["X-Content-Type-Options"] = "nosniff"
        response["Content-Security-Policy"] = "sandbox"
        response["Cache-Control"] = "private, no-store"
        return response

    def perform_content_negotiation(self, request, force=False):
        """Keep `format` for ourselves: REST framework would look for a renderer of that name."""
        renderer = self.get_renderers()[0]
        return renderer, renderer.media_type


class Again(VolumeView):
    """The same area and options once more, on this task or on another of its project."""

    def post(self, request, pk=None, saved=None):
        """Start it."""
        task = self.task(request, pk, change=True)
        asked = self.body(request, "task")
        document = _read(task, saved)
        other = task
        if asked.get("task") not in (None, str(task.id)):
            other = self.task(request, str(asked["task"])[:64], change=True)
            if other.project.pk != task.project.pk:
                raise refused(409, "the other task belongs to another project; choose one of this")
            if document["control"] is not None:
                raise refused(
                    409,
                    "this measurement was scaled by control of its own task; measure the other "
                    "task with control of its own",
                )
        folder = start(
            request,
            other,
            area=document["area"],
            options=checked_options(document["options"]),
            control=checked_control(document["control"]),
            name=document["name"],
        )
        return self.answer({"job": folder.job, "task": str(other.id), "state": "queued"}, 202)


class Series(VolumeView):
    """The project's tasks over time, by the areas that their measurements share."""

    _MOST_TASKS, _MOST_ROWS = 100, 500

    def get(self, request, pk=None):
        """Return the areas of this task's project and what was measured in each."""
        task = self.task(request, pk)
        whole = may_view_project(request, task.project)
        series, rows = {}, 0
        for other in self._tasks(task):
            if not (whole or other.public):
                continue
            for saved, path in saved_paths(other):
                rows += 1
                if rows > self._MOST_ROWS:
                    break
                try:
                    entry = entry_of(path, saved)
                except (UnreadableError, MisshapenError):
                    continue
                key = entry["area_key"]
                group = {"area_key": key, "name": entry["name"], "rows": []}
                series.setdefault(key, group)["rows"].append(self._row(other, saved, entry))
        return self.answer(list(series.values()))

    def _tasks(self, task):
        found = self.queryset.filter(project=task.project).order_by("created_at")
        return found[: self._MOST_TASKS]

    @staticmethod
    def _row(task, saved, entry):
        keys = ("volume_m3", "cut_m3", "fill_m3", "std_m3", "shape", "base")
        return {
            "task": str(task.id),
            "task_name": task.name,
            "date": task.created_at.isoformat(),
            "measurement": saved,
            **{key: entry["summary"][key] for key in keys},
        }
