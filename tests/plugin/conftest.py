"""The stand-in for WebODM, started once; its modules have WebODM's names, in their own process."""

import subprocess
import sys
from pathlib import Path

import pytest
from visitors import Visitor

HOST = Path(__file__).parent / "host"
collect_ignore_glob = ["host/*"]


def pytest_collection_modifyitems(items):
    """WebODM's own Python and Django tell all of it; on others tests/panel uses the same server."""
    for item in items:
        if item.path.parent == HOST.parent and "host" in item.fixturenames:
            item.add_marker("webodm_python")


class Host:
    """Where the stand-in is, its tasks by name, and its visitors."""

    def __init__(self, base: str, data: Path) -> None:
        self.base, self.data = base, data
        self.owner, self.viewer = self.visitor("owner"), self.visitor("viewer")
        self.changer, self.other = self.visitor("changer"), self.visitor("other")
        self.nobody = self.visitor(None)
        found = self.owner.get("/test/tasks").json
        self.tasks = {name: row["id"] for name, row in found.items()}
        self.projects = {name: row["project"] for name, row in found.items()}

    def visitor(self, user):
        return Visitor(self.base, user)

    def assets(self, name: str) -> Path:
        project = str(self.projects[name])
        return self.data / "media" / "project" / project / "task" / self.tasks[name] / "assets"

    @property
    def jobs(self) -> Path:
        """Where the plugin keeps jobs; made by the first one, which may be yet to come."""
        folder = self.data / "media" / "plugins" / "volcalc" / "jobs"
        folder.mkdir(parents=True, exist_ok=True)
        return folder


@pytest.fixture(scope="session")
def host(tmp_path_factory):
    data = tmp_path_factory.mktemp("host")
    command = [sys.executable, str(HOST / "serve.py"), "--port", "0", "--data", str(data)]
    with (data / "log").open("w") as log:
        server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
    try:
        line = server.stdout.readline()
        assert line.startswith("http"), (data / "log").read_text()
        yield Host(line.strip(), data)
    finally:
        server.terminate()
        server.wait(10)
        server.stdout.close()


@pytest.fixture(scope="session")
def beach_task(host):
    return host.tasks["Beach"]


@pytest.fixture(scope="session")
def kept(host, beach_task):
    """A measurement of the beach that its owner saved."""
    return host.owner.saved(beach_task, options={"density": 1.6, "density_sigma": 0.1})
