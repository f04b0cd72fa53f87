"""Views on saved measurements."""

import contextlib
import importlib

from django.db import transaction
from django.db.models import F
from django.http import HttpResponse
from rest_framework import exceptions
from rest_framework.renderers import JSONRenderer

from ..files.inputs import checked_control, checked_name
from ..files.list_rows import Budget, TooLargeError, UnreadError, entry_of
from ..files.saved import checked_document, read_document, write_document
from ..files.store import (
    UnreadableError,
    in_turn,
    is_id,
    saved_path,
    saved_paths,
    why_full,
)
from ..files.untrusted_json import MisshapenError
from . import database
from .base import PACKAGE, VolumeView, jobs_root, plugin_here, refused
from .requested_options import checked_options
from .starting import start

__all__ = ["Again", "Export", "Measurements", "OneMeasurement"]


_TYPES = {"csv": "text/csv", "geojson": "application/geo+json", "html": "text/html"}


def _reading():
    """Let two requests at once read documents: each takes half a second and up to 150 MB.

    Who finds no place soon is to come again: the other pages need the workers that would wait.
    """
    return in_turn(jobs_root(), 2, ".reading", wait_s=0.5)


def _read(task, saved):
    """Return a saved measurement, or say that there is none or what is wrong with it."""
    if not is_id(saved):
        raise exceptions.NotFound("there is no such measurement")
    try:
        return read_document(saved_path(task, saved), saved, task)
    except UnreadableError as error:
        raise exceptions.NotFound(f"there is no such measurement ({error})") from None
    except MisshapenError as error:
        raise refused(422, f"the file of this measurement is damaged: {error}") from None


@contextlib.contextmanager
def _changing(task, saved):
    """Yield the path of a measurement to change, to one request at a time.

    WebODM is told by how much its task grew. Its own way to find out reads every folder of the
    task, and then waits for the broker, which may not answer.
    """
    try:
        with in_turn(jobs_root()):
            path = saved_path(task, saved)
            before = _size(path)
            yield path
            grown = (_size(path) - before) / 1024 / 1024
    except UnreadableError as error:
        words = "move it away, or ask WebODM's administrator"
        raise refused(409, f"nothing can be saved with this task: {error}; {words}") from None
    # Update the size only: other fields may have changed since the task was read.
    type(task).objects.filter(pk=task.pk).update(size=F("size") + grown)


def _size(path):
    try:
        return path.lstat().st_size
    except FileNotFoundError:
        return 0


def _shown(request, document, names):
    """Return a document with its author, whom anonymous visitors do not see."""
    user = names.get(document["id"]) if request.user.is_authenticated else None
    return {**document, "user": user}


class Measurements(VolumeView):
    """The saved measurements of a task."""

    def get(self, request, pk=None):
        """List them, the oldest first; one that cannot be read is listed as such."""
        task = self.task(request, pk)
        logged_in = request.user.is_authenticated
        names = database.names(plugin_here(), task) if logged_in else {}
        budget = Budget()
        return self.answer(
            [
                {**self._row(saved, path, budget), "id": saved, "user": names.get(saved)}
                for saved, path, _ in saved_paths(task)
            ]
        )

    @staticmethod
    def _row(saved, path, budget):
        row = dict.fromkeys(("name", "date", "user", "summary", "options", "problem"))
        row["unread"] = False
        try:
            row.update(entry_of(path, saved, budget))
        except (UnreadError, TooLargeError) as error:
            row.update(name="(not read)", unread=isinstance(error, UnreadError))
            return {**row, "readable": True, "problem": str(error)}
        except (UnreadableError, MisshapenError) as error:
            return {**row, "readable": False, "problem": str(error)[:300]}
        del row["area_key"]
        return {**row, "readable": True}

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
        # Checked before it is written, so that it can be read again.
        document = checked_document(document)
        user = (folder.about() or {}).get("user_name")
        plugin = plugin_here()
        with _changing(task, document["id"]) as path:
            path.parent.mkdir(parents=True, exist_ok=True)
            full = why_full(task, document["id"])
            if full is not None:
                raise refused(409, full)
            write_document(path, document)
            database.remember(plugin, task, document["id"], user)
        return self.answer({**document, "user": user}, 201)


class OneMeasurement(VolumeView):
    """One saved measurement."""

    def get(self, request, pk=None, saved=None):
        """Return the document; its text is made while no more than one other is."""
        task = self.task(request, pk)
        names = database.names(plugin_here(), task)
        with _reading():
            data = JSONRenderer().render(_shown(request, _read(task, saved), names))
        return HttpResponse(data, content_type="application/json")

    def patch(self, request, pk=None, saved=None):
        """Give it another name."""
        task = self.task(request, pk, change=True)
        asked = self.body(request, "name")
        name = checked_name(asked.get("name"))
        with _reading():
            document = {**_read(task, saved), "name": name}
        with _changing(task, saved) as path:
            if not path.exists():
                raise exceptions.NotFound("there is no such measurement")
            write_document(path, document)
        return self.answer(_shown(request, document, database.names(plugin_here(), task)))

    def delete(self, request, pk=None, saved=None):
        """Remove it; also one that cannot be read."""
        task = self.task(request, pk, change=True)
        if not is_id(saved):
            raise exceptions.NotFound("there is no such measurement")
        plugin = plugin_here()
        # Both or neither: a file that is gone and remembered would be called lost ever after.
        with _changing(task, saved) as path, transaction.atomic():
            database.forget(plugin, task, saved)
            try:
                path.unlink()
            except FileNotFoundError:
                raise exceptions.NotFound("there is no such measurement") from None
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
        names = database.names(plugin_here(), task)
        pages = importlib.import_module(f"{PACKAGE}.quantify_client.report.document.saved_export")
        with _reading():
            document = _shown(request, _read(task, saved), names)
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
        with _reading():
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
        self.sweep(always=True)
        folder = start(
            request,
            other,
            area=document["area"],
            options=checked_options(document["options"]),
            control=checked_control(document["control"]),
            name=document["name"],
        )
        return self.answer({"job": folder.job, "task": str(other.id), "state": "queued"}, 202)
