"""A node, photographs, and a job that sends them there."""

import threading
import time

import pytest
from nodeodm import TOKEN, NodeODM
from pace import PACE
from photographs import all_zip, photographs

from quantify_client.jobs import create_job, plan_job, run_job


@pytest.fixture
def node(tmp_path):
    with NodeODM(tmp_path / "node", archive=all_zip(), token=TOKEN).running() as node:
        yield node


@pytest.fixture
def images(tmp_path):
    return photographs(tmp_path / "photos", 6, pad=30_000)


class Driver:
    """A job in a folder, and everything that it has said."""

    def __init__(self, node, images, folder):
        self.node, self.images, self.folder, self.events = node, images, folder, []

    def create(self, **rest):
        plan = plan_job(self.images, self.node.url, TOKEN, **rest)
        return create_job(plan, self.folder)

    def run(self, **rest):
        rest = {"patience_h": 5 / 3600, "pace": PACE, **rest}
        return run_job(self.folder, TOKEN, report=self.events.append, **rest)

    @property
    def messages(self):
        return [event.text for event in self.events if event.kind == "message"]

    @property
    def said(self):
        return "\n".join(self.messages)

    def goes_away_at(self, kind, seconds):
        """Take the node away at the job's first event of a kind, and bring it back."""

        def away():
            while not self.of(kind):
                time.sleep(0.005)
            self.node.stop()
            time.sleep(seconds)
            self.node.start()

        thread = threading.Thread(target=away)
        thread.start()
        return thread

    def of(self, kind):
        return [event for event in self.events if event.kind == kind]

    def require_complete(self):
        """The archive is the node's, and the node has exactly the photographs."""
        assert (self.folder / "all.zip").read_bytes() == self.node.archive
        alive = [uuid for uuid, task in self.node.tasks.items() if task.status == 40]
        assert len(alive) == 1
        assert self.node.files(alive[0]) == {path.name: path.read_bytes() for path in self.images}
        assert not list(self.folder.glob("*.part"))
        assert not list(self.folder.glob("*.zip.*"))


@pytest.fixture
def job(node, images, tmp_path):
    return Driver(node, images, tmp_path / "job")
