"""The committed build: small, and what its sources give."""

import json
import shutil
import subprocess

import pytest

from quantify_client.report.wording.notices import in_units
from quantify_client.report.wording.units import named_units

from .conftest import PUBLIC, REPOSITORY

pytestmark = pytest.mark.one_python

PANEL = REPOSITORY / "plugin" / "panel"
MOST_BYTES = 150_000  # the promise is 300 kB; this leaves room to notice


def test_the_pages_assets_are_small():
    sizes = {path.name: path.stat().st_size for path in PUBLIC.rglob("*") if path.is_file()}
    print(sizes)
    assert sum(sizes.values()) < MOST_BYTES


def test_no_html_is_ever_made_of_a_text():
    for path in (PANEL / "src").iterdir():
        text = path.read_text()
        for way in ("dangerouslySetInnerHTML", "innerHTML", "insertAdjacentHTML", "document.write"):
            assert way not in text, f"{path.name} uses {way}"


def test_the_committed_build_is_what_its_sources_give(tmp_path):
    npm = shutil.which("npm")
    if npm is None:
        pytest.skip("no npm on this machine: the build cannot be made again")
    copy = tmp_path / "panel"
    shutil.copytree(PANEL, copy, ignore=shutil.ignore_patterns("node_modules"))
    run = subprocess.run(
        [npm, "ci", "--no-audit", "--no-fund"],
        cwd=copy,
        capture_output=True,
        text=True,
        check=False,
    )
    if run.returncode:
        pytest.skip(f"npm cannot install here: {run.stderr.strip().splitlines()[-1:]}")
    out = tmp_path / "build"
    subprocess.run([npm, "run", "build", "--", str(out)], cwd=copy, check=True)
    made = {path.name: path.read_bytes() for path in out.iterdir()}
    committed = {path.name: path.read_bytes() for path in (PUBLIC / "build").iterdir()}
    assert made == committed, "run `npm ci && npm run build` in plugin/panel and commit the build"


def test_the_panel_tells_quantities_in_sentences_as_the_reports_do():
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node on this machine: the panel's units cannot be tried")
    sentences = [
        "gives 7.91 m3, 0.33 m3 from the volume: more than +-0.29 m3; over 1,500 m, 12 m2 of it",
        "give --max-gap 3 or m3; 4 mm, 5 m/s, 5 M, area 7 (5, -4.25)",
    ]
    script = f"""
        globalThis.window = {{ localStorage: {{ getItem: () => "imperial" }} }};
        const units = (await import({json.dumps((PANEL / "src/units.js").as_uri())})).unitSystem();
        console.log(JSON.stringify({json.dumps(sentences)}.map((s) => units.sentence(s))));
    """
    run = subprocess.run(
        [node, "--input-type=module", "-e", script], capture_output=True, text=True, check=True
    )
    assert json.loads(run.stdout) == [in_units(s, named_units("us")) for s in sentences]
