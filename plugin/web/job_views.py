"""Views on jobs: measurements that wait, run or have ended, and are not saved yet."""

from django.http import HttpResponse
from rest_framework.exceptions import NotFound

from ..files.folders import ENDED, all_jobs
from ..files.inputs import checked_control, checked_name
from .base import VolumeView, jobs_root, refused
from .listing import job_row, own_rows
from .requested_options import checked_options
from .starting import area_of, start

__all__ = ["Drop", "JobResult", "Jobs", "OneJob", "StartAgain"]


class Jobs(VolumeView):
    """The visitor's own measurements: under way, or ended and not forgotten."""

    def get(self, request, pk=None):
        """List them, so that any page finds them again."""
        task = self.task(request, pk)
        self.sweep()
        return self.answer(own_rows(jobs_root(), task, request.user))

    def post(self, request, pk=None):
        """Start one."""
        task = self.task(request, pk, change=True)
        asked = self.body(request, "area", "options", "control", "name")
        self.sweep(always=True)
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
        folder = self.job(request, self.task(request, pk), job)
        jobs = all_jobs(jobs_root())
        rows = [job_row(one, about, jobs) for one, about in jobs if one.job == folder.job]
        if not rows:
            raise NotFound("this measurement was forgotten meanwhile")
        return self.answer(rows[0])

    def delete(self, request, pk=None, job=None):
        """End it; one that has ended already stays as it is."""
        task = self.task(request, pk)
        folder = self.job(request, task, job)
        if folder.state()["state"] in ("queued", "running", "lost"):
            folder.cancel()  # the worker looks for this, and needs no message
        return self.answer({"job": job, "state": folder.state()["state"]})


class Drop(VolumeView):
    """Forgetting a measurement that has ended."""

    def post(self, request, pk=None, job=None):
        """Forget it with its result; what was saved of it stays."""
        folder = self.job(request, self.task(request, pk), job)
        if folder.state()["state"] not in ENDED:
            raise refused(409, "the measurement still goes on; cancel it first")
        folder.remove()
        return HttpResponse(status=204)


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


class StartAgain(VolumeView):
    """One that was lost, cancelled or failed, once more."""

    def post(self, request, pk=None, job=None):
        """Queue what was asked the first time; the new one takes the old one's place."""
        task = self.task(request, pk, change=True)
        old = self.job(request, task, job)
        state, asked = old.state()["state"], old.asked()
        if state not in ENDED:
            raise refused(409, "the measurement still goes on; wait for it, or cancel it first")
        if state == "done":
            raise refused(409, "the measurement is done; open its result")
        if asked is None:
            raise refused(409, "what was asked is no longer there; measure anew")
        wanted = {key: asked[key] for key in ("area", "options", "control", "name")}
        folder = start(request, task, **wanted)
        if (old.about() or {}).get("user") == request.user.pk:
            old.remove()
        return self.answer({"job": folder.job, "state": folder.state()["state"]}, 202)
