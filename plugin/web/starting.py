"""From a checked request to a job in WebODM's queue."""

import contextlib
import logging
import os

from ..files.folders import new_job
from ..files.inputs import LIMITS, checked_area, in_panel_words
from ..files.store import UnreadableError, in_turn, read_capped, read_head
from ..files.untrusted_json import MisshapenError, read_json
from ..quantify_client.errors import UsageError
from ..quantify_client.options import AUTO, choose_shape, read_options
from ..worker.entry import run_job
from .base import COMPLETED, PACKAGE, jobs_root, refused
from .broker import BrokerError, enqueue
from .listing import message_of, settle, slots_taken

__all__ = ["area_of", "crop_of", "has_crs", "reason_not", "sources_of", "start"]

_LONGEST_NAME = 80
# How much is read of a cloud's file and of its tiles' index to find a coordinate system.
_CLOUD_HEAD, _MOST_INDEX = 100_000, 1_000_000


def sources_of(task):
    """Return the paths of the task's tiles and of its cloud's file; None where there is none."""
    tiles = task.assets_path("entwine_pointcloud", "ept.json")
    found = {"ept": os.path.abspath(tiles) if os.path.isfile(tiles) else None, "laz": None}
    for asset in ("georeferenced_model.laz", "georeferenced_model.las"):
        path = task.get_asset_download_path(asset)
        if found["laz"] is None and os.path.isfile(path):
            found["laz"] = os.path.abspath(path)
    return found


def has_crs(task, sources):
    """Whether the coordinate system of the task's cloud is known.

    WebODM takes it from the rasters: of a task without any, only the cloud can tell.
    """
    if task.epsg or task.wkt:
        return True
    with contextlib.suppress(UnreadableError, MisshapenError):
        index = read_json(read_capped(sources["ept"], _MOST_INDEX)) if sources["ept"] else {}
        srs = index.get("srs") if isinstance(index, dict) else None
        if isinstance(srs, dict) and (srs.get("wkt") or srs.get("horizontal")):
            return True
    with contextlib.suppress(UnreadableError):
        head, _ = read_head(sources["laz"], _CLOUD_HEAD) if sources["laz"] else (b"", 0)
        # The user id of the LAS records that hold a CRS, whether GeoTIFF keys or WKT.
        return b"LASF_Projection" in head
    return False


def reason_not(task):
    """Return why the task cannot be measured; None when it can."""
    if task.status != COMPLETED:
        return "The task is not completed."
    if not any(sources_of(task).values()):
        return "The task has no georeferenced point cloud."
    return None


def crop_of(task):
    """Return the task's crop as GeoJSON (longitude, latitude); None without one.

    Its own coordinates: WebODM's GeoJSON of it has latitude first.
    """
    crop = task.crop
    if crop is None or crop.geom_type not in ("Polygon", "MultiPolygon"):
        return None
    if crop.num_coords > LIMITS["vertices"]:
        return None  # too many to be measured, and to be sent to everyone who looks
    parts = crop.coords if crop.geom_type == "MultiPolygon" else (crop.coords,)
    rings = [[[[x, y] for x, y, *_ in ring] for ring in part] for part in parts]
    if len(rings) == 1:
        return {"type": "Polygon", "coordinates": rings[0]}
    return {"type": "MultiPolygon", "coordinates": rings}


def area_of(task, wanted):
    """Return what is to be measured as a FeatureCollection, or AUTO; None for the whole cloud."""
    if wanted == "whole":
        return None
    if wanted == AUTO:
        return AUTO
    if wanted == "crop":
        crop = crop_of(task)
        if crop is None:
            raise MisshapenError(
                f"the task has no crop, or one of more than {LIMITS['vertices']} vertices; draw an "
                "area, or measure the whole cloud"
            )
        return checked_area({"type": "Feature", "properties": {"name": "crop"}, "geometry": crop})
    if not isinstance(wanted, dict):
        raise MisshapenError('area has to be GeoJSON, "crop", "auto" or "whole"')
    return checked_area(wanted)


def start(request, task, *, area, options, control, name):
    """Queue a measurement and return its job's folder."""
    reason = reason_not(task)
    if reason is not None:
        raise refused(409, reason)
    _require_agreement(area, options, control)
    root = jobs_root()
    assets = os.path.abspath(task.assets_path())
    about = {
        "task": str(task.id),
        "user": request.user.pk,
        "user_name": request.user.get_username(),
        "name": name,
        "assets": assets,
    }
    asked = {
        "task": str(task.id),
        "project": task.project.pk,
        "task_name": (task.name or "task")[:_LONGEST_NAME],
        "name": name,
        "assets": assets,
        "sources": sources_of(task),
        "area": area,
        "options": options,
        "control": control,
    }
    folder = _admitted(root, about, asked)
    try:
        where = (PACKAGE, os.path.abspath(root), folder.job)
        enqueue(run_job, *where, message=message_of(folder.job))
    except BrokerError:
        # Without a message the job would wait for ever, and count against its user's limit.
        folder.remove()
        logging.getLogger("app.logger").exception("volcalc: nothing can be queued")
        raise refused(
            503, "WebODM's queue does not answer; try again in a minute, or restart WebODM", wait=30
        ) from None
    return folder


def _admitted(root, about, asked):
    """Return the folder of a new job, unless its user has enough of them already."""
    settle(root, about["user"])
    with in_turn(root):
        if slots_taken(root, about["user"]) >= LIMITS["jobs"]:
            raise refused(
                429,
                f"{LIMITS['jobs']} measurements of yours wait or run; wait for one of them, or "
                "cancel it",
            )
        return new_job(root, about, asked)


def _require_agreement(area, options, control):
    """Refuse at once what the library would refuse in the worker."""
    if "density_sigma" in options and "density" not in options:
        raise MisshapenError("density_sigma goes with density: give both")
    try:
        read = read_options({**options, "area": area, "gcp": control})
        choose_shape(read, has_crs=True, is_odm=True)
    except UsageError as error:
        raise MisshapenError(in_panel_words(str(error))) from None
