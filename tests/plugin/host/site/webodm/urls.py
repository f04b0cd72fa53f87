"""Addresses: those of WebODM that a plugin meets, and some for tests only."""

import json
import os
import signal

import worker.celery
from app import models
from app.api.tasks import task_detail
from app.plugins.views import api_view_handler, app_view_handler
from django.conf import settings
from django.contrib.auth import get_user_model, login, logout
from django.http import Http404, HttpResponse, JsonResponse
from django.middleware.csrf import get_token
from django.urls import re_path
from django.views.decorators.csrf import csrf_exempt
from django.views.static import serve


@csrf_exempt
def log_in(request):
    """For tests: be that user, without a password; nobody when none is named."""
    name = request.GET.get("user") or request.POST.get("user")
    if name:
        user = get_user_model().objects.get(username=name)
        login(request, user, backend="app.permissions.Backend")
    else:
        logout(request)
    return JsonResponse({"user": name, "csrf": get_token(request)})


def tasks(request):
    """For tests: the ids of the tasks by their names."""
    rows = models.Task.objects.select_related("project").order_by("created_at")
    return JsonResponse(
        {task.name: {"id": str(task.id), "project": task.project.pk} for task in rows}
    )


_SIGNALS = {"kill": signal.SIGKILL, "stop": signal.SIGSTOP, "go": signal.SIGCONT}


@csrf_exempt
def worker_signal(request, name):
    """For tests: kill the worker in the middle of whatever it does, or have it stand still."""
    pid = int((worker.celery.ROOT / "worker.pid").read_text())
    os.kill(pid, _SIGNALS[name])
    return JsonResponse({"pid": pid, "busy": any(worker.celery.RUNNING.glob("*.pid"))})


def worker_get(request, job):
    """Return what a job returned, to anyone: as WebODM does."""
    path = worker.celery.RESULTS / f"{os.path.basename(job)}.json"
    if not path.is_file():
        return JsonResponse({"error": "Task not ready"})
    return JsonResponse(json.loads(path.read_text()))


def page(request, path):
    """Serve the pages that a browser test brings."""
    if not settings.PAGES:
        raise Http404
    return serve(request, path or "index.html", document_root=settings.PAGES)


def token(request):
    """Set the cookie csrftoken, as any page of WebODM does."""
    get_token(request)
    return HttpResponse("ok")


urlpatterns = [
    re_path(r"^test/login$", log_in),
    re_path(r"^test/tasks$", tasks),
    re_path(r"^test/(?P<name>kill)$", worker_signal),
    re_path(r"^test/worker/(?P<name>kill|stop|go)$", worker_signal),
    re_path(r"^test/token$", token),
    re_path(r"^api/workers/get/(?P<job>[^/]+)$", worker_get),
    re_path(r"^api/projects/(?P<project>\d+)/tasks/(?P<pk>[^/]+)/$", task_detail),
    re_path(r"^api/plugins/(?P<plugin_name>[^/.]+)/(.*)$", api_view_handler),
    re_path(r"^plugins/(?P<plugin_name>[^/.]+)/(.*)$", app_view_handler),
    re_path(r"^pages/(?P<path>.*)$", page),
]
