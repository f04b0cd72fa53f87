"""A stand-in for WebODM with the plugin and two users, for tests and for working on the panel.

    python tests/plugin/host/serve.py --port 8123 --data /tmp/host

Log in by GET /test/login?user=owner (or changer, viewer, other; without user: out). /test/tasks
names the tasks: "Beach" with tiles, "Beach LAZ" with the file only, "Public" for everyone, "Empty"
without a cloud, "Elsewhere" of another project, "Running", "Longggg...", "Frilly" with a crop of
10,001 corners.
/test/worker/kill kills the worker, /test/worker/stop has it stand still until /test/worker/go.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import socketserver
import subprocess
import sys
import threading
import time
import zipfile
from pathlib import Path
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

HERE = Path(__file__).resolve().parent
REPOSITORY = HERE.parents[2]
DEMO = REPOSITORY / "quantify_client" / "demo" / "brighton_beach.laz"
EXTENT = (-91.994584, 46.842140, -91.993173, 46.843032)
CROP = (
    "POLYGON ((-91.9943 46.8422, -91.9937 46.8422, -91.9937 46.8426, -91.9943 46.8426, "
    "-91.9943 46.8422))"
)


def main() -> None:
    """Prepare the data where there is none, and serve until interrupted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, default=8123)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--zip", type=Path, help="a plugin zip; built from the checkout without")
    parser.add_argument("--public", type=Path, help="serve this folder as the plugin's public/")
    parser.add_argument("--pages", type=Path, help="serve this folder at /pages/")
    parser.add_argument("--fresh", action="store_true", help="forget what is there")
    given = parser.parse_args()
    data = given.data.resolve()
    if given.fresh:
        shutil.rmtree(data, ignore_errors=True)
    prepare(data, given.zip, given.public)
    os.environ.update(
        HOST_DATA=str(data), HOST_PAGES=str(given.pages.resolve() if given.pages else "")
    )
    os.environ["DJANGO_SETTINGS_MODULE"] = "webodm.settings"
    sys.path.insert(0, str(HERE / "site"))
    import django

    django.setup()
    make_tasks(data)
    threading.Thread(target=keep_working, daemon=True).start()
    with make_server("127.0.0.1", given.port, application(), Server, Quiet) as server:
        print(f"http://127.0.0.1:{server.server_port}", flush=True)
        server.serve_forever()


class Server(socketserver.ThreadingMixIn, WSGIServer):
    """One thread for each request."""

    daemon_threads = True


class Quiet(WSGIRequestHandler):
    """Says nothing of what goes well."""

    def log_message(self, format: str, *args: object) -> None:
        """Report errors of the server only."""
        if len(args) > 1 and str(args[1]).startswith("5"):
            super().log_message(format, *args)


def application():
    """Return Django's application."""
    from django.core.wsgi import get_wsgi_application

    return get_wsgi_application()


def prepare(data: Path, archive: Path | None, public: Path | None) -> None:
    """Unpack the plugin where WebODM would have it."""
    for name in ("media/plugins", "queue", "running", "results"):
        (data / name).mkdir(parents=True, exist_ok=True)
    for stale in (data / "running").iterdir():
        stale.unlink()
    plugins = data / "media" / "plugins"
    (plugins / "__init__.py").touch()
    folder = plugins / "volcalc"
    jobs = folder / "jobs"
    for old in folder.iterdir() if folder.is_dir() else ():
        if old != jobs:
            shutil.rmtree(old) if old.is_dir() and not old.is_symlink() else old.unlink()
    if archive is None:
        sys.path.insert(0, str(REPOSITORY))
        from quantify_client.plugin_build import build_plugin

        archive = build_plugin(data)
    with zipfile.ZipFile(archive) as packed:
        packed.extractall(plugins)
    if public is not None:
        shutil.rmtree(folder / "public", ignore_errors=True)
        (folder / "public").symlink_to(public.resolve())


def make_tasks(data: Path) -> None:
    """Make the users, projects and tasks, once."""
    from django.core.management import call_command

    if (data / "db.sqlite3").exists():
        return
    thin(DEMO, data / "cloud.laz")
    call_command("migrate", run_syncdb=True, verbosity=0)
    from app.models import Project, Right
    from django.contrib.auth.models import User

    users = {name: User.objects.create(username=name) for name in ("owner", "viewer", "other")}
    users["changer"] = User.objects.create(username="changer")
    beach = Project.objects.create(owner=users["owner"], name="Beach")
    for name, rights in (("viewer", ["view"]), ("changer", ["view", "change"])):
        for right in rights:
            Right.objects.create(project=beach, user=users[name], right=f"{right}_project")
    elsewhere = Project.objects.create(owner=users["other"], name="Elsewhere")
    mine = Project.objects.create(owner=users["owner"], name="Mine")
    _task(beach, "Beach", ept=True, laz=True, day=1)
    _task(beach, "Beach LAZ", laz=True, day=2)
    _task(beach, "Public", laz=True, day=3, public=True)
    _task(beach, "Empty", day=4)
    _task(beach, "Running", day=5, status=20)
    _task(elsewhere, "Elsewhere", day=6)
    _task(mine, "Mine", laz=True, day=7)
    _task(mine, "Long".ljust(250, "g"), laz=True, day=8)
    corners = [f"{-91.994 + place * 1e-9:.9f} 46.8422" for place in range(10_001)]
    frilly = f"POLYGON (({', '.join([*corners, corners[0]])}))"
    _task(mine, "Frilly", laz=True, day=9, crop_wkt=frilly)
    # WebODM has the coordinate system from the rasters.
    _task(elsewhere, "No rasters", ept=True, laz=True, day=10, epsg=None)


def thin(cloud: Path, path: Path) -> None:
    """Write every fourth point of the demo's cloud: it is measured often."""
    import laspy
    import numpy as np

    las = laspy.read(cloud)
    las.points = las.points[np.arange(0, len(las.points), 4)]
    las.write(path)


def _task(project, name: str, *, ept: bool = False, laz: bool = False, day: int, **fields) -> None:
    from datetime import datetime, timezone

    from app.models import Task

    task = Task.objects.create(
        project=project,
        name=name,
        created_at=datetime(2024, 5, day, tzinfo=timezone.utc),
        extent_text=json.dumps(EXTENT),
        points=415_000,
        **{"crop_wkt": CROP, "epsg": 32615, **fields},
    )
    model = Path(task.get_asset_download_path("georeferenced_model.laz"))
    model.parent.mkdir(parents=True)
    if laz:
        shutil.copy(_cloud(name), model)
    if ept:
        _write_tiles(_cloud(name), Path(task.assets_path("entwine_pointcloud")))
    task.update_size()


def _cloud(name: str) -> Path:
    """Return the cloud of a task: that of "Long" takes as long as people have to cancel it."""
    return DEMO if name.startswith("Long") else Path(os.environ["HOST_DATA"]) / "cloud.laz"


def _write_tiles(cloud: Path, folder: Path) -> None:
    """Write a cloud as EPT."""
    import laspy
    import numpy as np

    sys.path.insert(0, str(REPOSITORY / "tests"))
    from clouds import write_ept

    points = laspy.read(cloud)
    write_ept(folder, np.column_stack([points.x, points.y, points.z]))


def keep_working() -> None:
    """Start a worker, and another one whenever it has died."""
    while True:
        main = HERE / "site" / "worker" / "main.py"
        command = [sys.executable, str(main), str(os.getpid())]
        subprocess.run(command, check=False)
        time.sleep(0.2)


if __name__ == "__main__":
    main()
