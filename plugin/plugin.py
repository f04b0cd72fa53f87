"""What WebODM loads: the panel's files and the addresses of the API.

Only WebODM's own packages may be imported when this module loads: the plugin's requirements are
installed after it, and an import that fails here means that they never are.
"""

from app.plugins import MountPoint, PluginBase

from .web.job_views import Drop, JobResult, Jobs, OneJob, StartAgain
from .web.overview import Overview, Series
from .web.saved_views import Again, Export, Measurements, OneMeasurement

__all__ = ["Plugin"]

_TASK = r"task/(?P<pk>[^/.]+)/"
_JOB = _TASK + r"jobs/(?P<job>[^/.]+)"
_SAVED = _TASK + r"measurements/(?P<saved>[^/.]+)"


class Plugin(PluginBase):
    """Volume (VolCalc)."""

    def include_js_files(self):
        """Load the panel, which is built already."""
        return ["main.js"]

    def include_css_files(self):
        """Load the panel's look, where it has a file of its own."""
        return ["main.css"] if self.path_exists("public/main.css") else []

    def api_mount_points(self):
        """Mount the API: see docs/webodm.md."""
        return [
            MountPoint(_TASK + r"?$", Overview.as_view()),
            MountPoint(_TASK + r"jobs/?$", Jobs.as_view()),
            MountPoint(_JOB + r"/?$", OneJob.as_view()),
            MountPoint(_JOB + r"/result/?$", JobResult.as_view()),
            MountPoint(_JOB + r"/drop/?$", Drop.as_view()),
            MountPoint(_JOB + r"/again/?$", StartAgain.as_view()),
            MountPoint(_TASK + r"measurements/?$", Measurements.as_view()),
            MountPoint(_SAVED + r"/?$", OneMeasurement.as_view()),
            MountPoint(_SAVED + r"/export/?$", Export.as_view()),
            MountPoint(_SAVED + r"/again/?$", Again.as_view()),
            MountPoint(_TASK + r"series/?$", Series.as_view()),
        ]
