"""What all views share: who may do what, one way of reading and one of refusing."""

import logging

from app.api.common import check_project_perms
from app.plugins.views import TaskView
from rest_framework import exceptions, status
from rest_framework.parsers import BaseParser
from rest_framework.response import Response

from ..files.folders import JobFolder, sweep
from ..files.store import BusyError, disk_words, is_id
from ..files.untrusted_json import MisshapenError, read_json

__all__ = [
    "PACKAGE",
    "TooLarge",
    "VolumeView",
    "jobs_root",
    "may_change",
    "may_view_project",
    "plugin_here",
    "refused",
]

#: WebODM itself refuses bodies of 10 MB; nothing here needs more than a tenth of that.
_MOST_BODY = 2_500_000

COMPLETED = 40

#: The plugin's own package, as WebODM has loaded it: "plugins.volcalc".
PACKAGE = __package__.rpartition(".")[0]


class TooLarge(exceptions.APIException):
    """The body is larger than anything that could be meant."""

    status_code = status.HTTP_413_REQUEST_ENTITY_TOO_LARGE


class _Json(BaseParser):
    """JSON from anybody: bounded, finite, and not nested without end."""

    media_type = "application/json"

    def parse(self, stream, media_type=None, parser_context=None):
        """Return the body's object."""
        data = stream.read(_MOST_BODY + 1)
        if len(data) > _MOST_BODY:
            raise TooLarge(f"the request is larger than {_MOST_BODY} bytes; simplify the area")
        try:
            value = read_json(data)
        except MisshapenError as error:
            raise exceptions.ParseError(f"the request cannot be read: {error}") from error
        if not isinstance(value, dict):
            raise exceptions.ParseError("the request has to be a JSON object")
        return value


def plugin_here():
    """Return this plugin as WebODM knows it."""
    from app.plugins.functions import get_plugin_by_name

    name = PACKAGE.split(".")[-1]
    plugin = get_plugin_by_name(name, only_active=False, refresh_cache_if_none=True)
    if plugin is None:
        raise exceptions.APIException("the plugin is not loaded; restart WebODM")
    return plugin


def jobs_root():
    """Return the folder of jobs, which WebODM's web processes and workers share."""
    return plugin_here().get_persistent_path("jobs")


def refused(code, words, wait=None):
    """Return an exception with a status and one line; `wait`: seconds until another try."""
    error = exceptions.APIException(words)
    error.status_code, error.wait = code, wait
    return error


def may_change(request, task):
    """Whether the visitor is logged in and may change the task's project."""
    return request.user.is_authenticated and _may(request, task.project, "change_project")


def may_view_project(request, project):
    """Whether the visitor sees all of the project's tasks."""
    return getattr(project, "public", False) or _may(request, project, "view_project")


def _may(request, project, right):
    try:
        check_project_perms(request, project, (right,))
    except exceptions.NotFound:
        return False
    return True


class VolumeView(TaskView):
    """A view on one task: permissions first, JSON in, one line of error out."""

    parser_classes = (_Json,)

    def handle_exception(self, exc):
        """Give every error the same shape; what is no HTTP error goes on to WebODM."""
        if isinstance(exc, MisshapenError):
            exc = exceptions.ValidationError(str(exc))
        elif isinstance(exc, BusyError):
            exc = refused(503, "others keep the server busy; try again in a moment", wait=2)
        elif isinstance(exc, OSError):
            logging.getLogger("app.logger").error("volcalc: %s", exc, exc_info=exc)
            exc = refused(507, disk_words(exc))
        response = super().handle_exception(exc)
        response.data = {"error": _one_line(response.data)}
        return response

    def task(self, request, pk, *, change=False):
        """Return the task, which the visitor may see; with `change`, whose project he may change.

        A task that he may not see is not found.
        """
        task = self.get_and_check_task(request, pk)
        if change:
            if not request.user.is_authenticated:
                raise refused(403, "log in to do this; results can be seen without")
            if not may_change(request, task):
                raise refused(403, "this takes the right to change the project; ask its owner")
        return task

    def sweep(self, always=False):
        """Forget jobs whose time has come, or whose task was deleted."""

        def living(tasks):
            found = self.queryset.model.objects.filter(pk__in=tasks)
            return {str(pk) for pk in found.values_list("pk", flat=True)}

        sweep(jobs_root(), living, always)

    def job(self, request, task, job):
        """Return the folder of a job of this task that the visitor has to do with."""
        missing = exceptions.NotFound("there is no such measurement under way on this task")
        if not is_id(job):
            raise missing
        folder = JobFolder(jobs_root(), job)
        about = folder.about()
        if about is None or about.get("task") != str(task.id):
            raise missing
        if not request.user.is_authenticated:
            raise refused(403, "log in to see measurements under way")
        if about.get("user") != request.user.pk and not may_change(request, task):
            raise missing
        return folder

    def body(self, request, *known):
        """Return the body's members, of which no others are known."""
        data = request.data if isinstance(request.data, dict) else {}
        unknown = [key for key in data if key not in known]
        if unknown:
            raise MisshapenError(
                f"the request has an unknown key {unknown[0][:40]!r}; known: {', '.join(known)}"
            )
        return data

    @staticmethod
    def answer(data, code=200):
        """Answer in JSON."""
        return Response(data, status=code)


def _one_line(data):
    if isinstance(data, dict):
        data = data.get("detail", next(iter(data.values()), ""))
    if isinstance(data, (list, tuple)):
        data = data[0] if data else ""
    return " ".join(str(data).split())[:500] or "the request was refused"
