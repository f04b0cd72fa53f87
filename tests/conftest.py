"""What all tests share: the same examples on every run, and a site to measure."""

import gc
import json
import signal
import zipfile

import jsonschema
import numpy as np
import pytest
from beach import frame_of
from clouds import write_las
from commands import PILE, SCHEMA, UTM, features
from hypothesis import settings
from known_task import make_task
from nodeodm import TOKEN, NodeODM
from terrains import EAST, LEVEL, NORTH, Errors, survey

from quantify_client.cli import main
from quantify_client.jobs import Pace

# What a shell starts in the background ignores Ctrl-C, and so would every process of the tests.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# A red build must be red again when it is run again, on any machine however slow.
settings.register_profile("ci", derandomize=True, deadline=None, print_blob=True)
settings.register_profile("second_python", settings.get_profile("ci"), max_examples=20)
settings.load_profile("ci")


def pytest_collection_modifyitems(items):
    """Begin with what takes long, so that the workers end together."""
    items.sort(key=lambda item: item.get_closest_marker("one_python") is None)


def pytest_collection_finish():
    """What thousands of tests are made of stays to the end: the collector need not look at it."""
    gc.freeze()


DOCUMENT = {
    *("schema", "source", "crs", "length_unit", "shape", "method", "grid_scale_factor", "scale"),
    *("results", "warnings", "provenance", "method_revision", "proposals"),
    *("kind", "alignment", "series"),
}
RESULT = {
    *("name", "volume_m3", "cut_m3", "fill_m3", "std_m3", "interval95_m3", "cut_std_m3"),
    *("cut_interval95_m3", "fill_std_m3", "fill_interval95_m3", "budget", "area_m2"),
    *("surface_area_m2", "perimeter_m", "min_z_m", "max_z_m", "max_height_m", "coverage"),
    *("points_used", "points_left_out", "slice_height_m", "slices", "mass_t", "mass_std_t"),
    *("base", "checks", "warnings"),
}


@pytest.fixture(scope="session", autouse=True)
def records(tmp_path_factory):
    """Keep the records of jobs out of the home of whoever runs the tests."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("state")
        patch.setenv("XDG_STATE_HOME", str(folder))
        yield folder / "quantify-client" / "jobs"


@pytest.fixture(scope="session")
def beach():
    """The measuring frame of the example survey."""
    return frame_of("EPSG:32615")


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """A cone of 268.08 m3 as LAZ in UTM and without a CRS, and its outline."""
    folder = tmp_path_factory.mktemp("site")
    points = survey(PILE.height, Errors(0.01, 0.0), 30_000)
    write_las(folder / "pile.laz", points, crs=UTM)
    local = points - [EAST, NORTH, LEVEL] + [1000.0, 2000.0, 50.0]
    np.savetxt(folder / "plain.csv", local, "%.3f", ",", header="x,y,z", comments="")
    # Coordinates without two alike: rounding them in other units changes no order.
    body = np.random.default_rng(7).normal(size=(5000, 3))
    np.savetxt(folder / "body.xyz", body / np.linalg.norm(body, axis=1)[:, None], "%.15f")
    (folder / "pile.geojson").write_text(features(PILE.area, names=["pile"]))
    np.save(folder / "points.npy", points)
    return folder


@pytest.fixture(scope="session")
def project(site, tmp_path_factory):
    """An ODM project folder, and its all.zip."""
    root = tmp_path_factory.mktemp("odm") / "quarry"
    (root / "odm_georeferencing").mkdir(parents=True)
    model = root / "odm_georeferencing" / "odm_georeferenced_model.laz"
    write_las(model, np.load(site / "points.npy"))
    (root / "odm_georeferencing" / "coords.txt").write_text("WGS84 UTM 15N\n500000 5000000\n")
    with zipfile.ZipFile(root.parent / "all.zip", "w") as archive:
        for file in sorted((root / "odm_georeferencing").iterdir()):
            archive.write(file, f"odm_georeferencing/{file.name}")
        archive.writestr("odm_report/stats.json", "{}")
    return root


@pytest.fixture(scope="session")
def known(tmp_path_factory):
    """A site of known volume: what a person has of it, and what a node makes of that."""
    return make_task(tmp_path_factory.mktemp("known"))


@pytest.fixture
def node(known, tmp_path):
    """A node that makes the known site of whatever it is sent."""
    with NodeODM(tmp_path / "node", archive=known.archive, token=TOKEN).running() as node:
        yield node


@pytest.fixture
def quick_jobs(monkeypatch):
    """Have the commands ask and try again faster than people want it."""
    from quantify_client.commands import jobs

    monkeypatch.setattr(jobs, "PACE", Pace(poll_s=0.02, pause_s=0.01, silence_s=2.0))


@pytest.fixture
def run(capsys):
    """Run the command line in this process; return its status, stdout and stderr."""

    def runner(*arguments):
        status = main([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        return status, out, err

    return runner


@pytest.fixture
def document(run):
    """Run with --json; check everything that every such run must hold, and return the document."""

    def runner(*arguments, status=0):
        found, out, err = run(*arguments, "--json")
        assert found == status, err
        document = json.loads(out)  # which also refuses anything before or after it
        jsonschema.Draft202012Validator(SCHEMA).validate(document)
        assert document.keys() == DOCUMENT
        for result in document["results"]:
            assert result.keys() == {"name", "error"} or result.keys() >= RESULT
        if status == 0:
            assert err == ""
        return document

    return runner
