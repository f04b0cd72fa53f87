"""A browser, and a host page on the stand-in for WebODM: real Leaflet, React and SystemJS.

PANEL_PICTURES=DIR in the environment keeps screenshots for the documentation.
"""

import importlib
import json
import os
import shutil
import subprocess
import sys
import urllib.request
from io import BytesIO
from pathlib import Path
from urllib.parse import urlencode

import pytest

HERE = Path(__file__).resolve().parent
REPOSITORY = HERE.parents[1]
PUBLIC = REPOSITORY / "plugin" / "public"
DEMO = REPOSITORY / "quantify_client" / "demo" / "brighton_beach.laz"
AREAS = REPOSITORY / "quantify_client" / "demo" / "areas.geojson"


def missing(words):
    """Leave tests out for want of something; who gave a WebODM to try is told by a failure."""
    if os.environ.get("WEBODM_URL"):
        pytest.fail(words)
    pytest.skip(words)


def need(module):
    try:
        return importlib.import_module(module)
    except ImportError:
        missing(f"{module} is not installed: pip install -e .[dev]")


@pytest.fixture(scope="module")
def chromium():
    """The browser; closed after the module, as its event loop would be in other tests' way."""
    api = need("playwright.sync_api")
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        missing("no chromium on this machine: apt install chromium")
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def stand_in(tmp_path_factory):
    """The address of the stand-in, and the folder of its data."""
    need("django")
    need("rest_framework")
    data = tmp_path_factory.mktemp("host")
    command = [sys.executable, REPOSITORY / "tests/plugin/host/serve.py", "--port", "0"]
    command += ["--data", data, "--pages", HERE / "pages", "--public", PUBLIC]
    with (data / "host.log").open("w") as log:
        server = subprocess.Popen(
            [str(word) for word in command],
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
        )
    try:
        address = server.stdout.readline().strip()
        assert address.startswith("http"), (data / "host.log").read_text()
        yield address, data
    finally:
        server.terminate()
        server.wait(20)
        server.stdout.close()


@pytest.fixture(scope="session")
def tasks(stand_in):
    """The stand-in's tasks by name: {"id", "project"}."""
    with urllib.request.urlopen(f"{stand_in[0]}/test/tasks") as answer:  # noqa: S310
        return json.load(answer)


@pytest.fixture(scope="session")
def task_cloud(stand_in, tmp_path_factory):
    """The cloud where OpenDroneMap puts it: its heights mean something else than a surveyor's."""
    cloud = tmp_path_factory.mktemp("task") / "odm_georeferencing" / "odm_georeferenced_model.laz"
    cloud.parent.mkdir()
    shutil.copy(stand_in[1] / "cloud.laz", cloud)
    return cloud


@pytest.fixture(scope="session")
def outline():
    """The round structure's outline: [[lon, lat], ...], not closed, a few points only."""
    from pyproj import Transformer

    rings = {
        feature["properties"]["name"]: feature["geometry"]["coordinates"][0]
        for feature in json.loads(AREAS.read_text())["features"]
    }
    to_degrees = Transformer.from_crs(32615, 4326, always_xy=True).transform
    return [list(to_degrees(x, y)) for x, y in rings["round structure"][:-1:3]]


@pytest.fixture(scope="session")
def orthophoto():
    """The cloud from above: PNG bytes and [[south, west], [north, east]]."""
    import laspy
    import numpy as np
    from PIL import Image
    from pyproj import Transformer

    with laspy.open(DEMO) as reader:
        points = reader.read()
    x, y = np.asarray(points.x), np.asarray(points.y)
    west, south, east, north = x.min(), y.min(), x.max(), y.max()
    cell = 0.2
    shape = (int((north - south) / cell) + 1, int((east - west) / cell) + 1)
    picture = np.zeros((*shape, 4), dtype=np.uint8)
    order = np.argsort(np.asarray(points.z))
    rows = ((north - y) / cell).astype(int)[order]
    columns = ((x - west) / cell).astype(int)[order]
    for band, values in enumerate((points.red, points.green, points.blue)):
        values = np.asarray(values)[order]
        picture[rows, columns, band] = values >> 8 if values.max() > 255 else values
    picture[rows, columns, 3] = 255
    image = Image.fromarray(picture).resize((shape[1] * 3, shape[0] * 3), Image.BICUBIC)
    out = BytesIO()
    image.save(out, "PNG")
    to_degrees = Transformer.from_crs(32615, 4326, always_xy=True).transform
    corners = (to_degrees(west, south), to_degrees(east, north))
    return out.getvalue(), [[lat, lon] for lon, lat in corners]


def keep_picture(page, path):
    """Write a screenshot with few colours: it goes into the repository."""
    from PIL import Image

    path.parent.mkdir(parents=True, exist_ok=True)
    shot = Image.open(BytesIO(page.screenshot())).convert("RGB")
    # Half of the palette for what is common, half for what is rare: thin lines keep their colour.
    ways = (Image.Quantize.MEDIANCUT, Image.Quantize.MAXCOVERAGE)
    halves = [shot.quantize(128, method=way).getpalette()[: 3 * 128] for way in ways]
    palette = Image.new("P", (1, 1))
    palette.putpalette([*halves[0], *halves[1]])
    few = shot.quantize(palette=palette, dither=Image.Dither.NONE)
    few.save(path, optimize=True)


class MapPage:
    """A page with the panel, and what a hand would do on it."""

    def __init__(self, page, address, pictures):
        self.page, self.address, self.pictures = page, address, pictures
        self.problems = []
        page.on("pageerror", lambda error: self.problems.append(str(error)))
        page.set_default_timeout(30_000)  # of a machine that does other things besides

    def open(self, *tasks, hash="", **query):
        wanted = [("task", f"{task['id']}:{name}") for name, task in tasks]
        wanted += [("project", tasks[0][1]["project"]), *query.items()]
        self.page.goto(f"{self.address}/pages/index.html?{urlencode(wanted)}{hash}")
        return self

    def open_panel(self):
        self.page.click(".leaflet-control-volcalc a")
        self.page.wait_for_selector(".vc-tabs")
        return self

    def pixel(self, place):
        at = self.page.evaluate(
            "([lon, lat]) => window.hostMap.latLngToContainerPoint([lat, lon])", place
        )
        box = self.page.locator("#map").bounding_box()
        return box["x"] + at["x"], box["y"] + at["y"]

    def click_map(self, place):
        self.page.mouse.click(*self.pixel(place))

    def draw(self, ring):
        self.page.click("text=Draw on the map")
        for place in ring:
            self.click_map(place)
        self.click_map(ring[0])
        self.page.wait_for_selector(".vc-areas li")

    def look_at(self, ring):
        self.page.evaluate(
            "(ring) => window.hostMap.setView(ring[0].slice().reverse(), 21, {animate: false})",
            ring,
        )

    def measure(self):
        self.page.click("text=Measure volume")
        self.page.wait_for_selector(".vc-hero", timeout=90_000)

    def hero(self):
        return self.page.inner_text(".vc-hero-number").replace("\u202f", "").replace("\u00a0", " ")

    def layers(self):
        return self.page.locator(".host-layers label span").all_inner_texts()

    def units(self, name):
        self.page.select_option("#units", name)

    def picture(self, name):
        if self.pictures:
            keep_picture(self.page, self.pictures / f"{name}.png")


@pytest.fixture
def open_page(chromium, stand_in, orthophoto):
    """Open map pages; fails when a script of one failed."""
    contexts, opened = [], []
    address, _ = stand_in
    kept = os.environ.get("PANEL_PICTURES")
    pictures = Path(kept) if kept else None
    image, bounds = orthophoto

    def make(user="owner", size=(1180, 760), **more):
        context = chromium.new_context(
            viewport={"width": size[0], "height": size[1]}, locale="en-GB", **more
        )
        contexts.append(context)
        context.request.get(f"{address}/test/login" + (f"?user={user}" if user else ""))
        context.route(
            "**/ortho.png", lambda route: route.fulfill(body=image, content_type="image/png")
        )
        page = MapPage(context.new_page(), address, pictures)
        page.ortho = {"image": "ortho.png", "bounds": json.dumps(bounds)}
        opened.append(page)
        return page

    yield make
    problems = [problem for page in opened for problem in page.problems]
    for context in contexts:
        context.close()
    assert not problems
