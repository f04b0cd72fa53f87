"""The zip: what is in it, that it is the same every time, and that WebODM can load it."""

import ast
import hashlib
import json
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from quantify_client import plugin_build
from quantify_client.cli import main
from quantify_client.plugin_build import build_plugin

ROOT = Path(__file__).parents[2]
WEBODM = {"app", "django", "rest_framework", "worker", "webodm", "numpy"}  # its own packages
MEASURED = """
import importlib, sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {absent}:
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Absent())
sys.path[:0] = {paths}
"""


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    return build_plugin(tmp_path_factory.mktemp("zip"))


@pytest.fixture(scope="module")
def unpacked(archive, tmp_path_factory):
    """The plugin under another package's name, as WebODM has it."""
    folder = tmp_path_factory.mktemp("media")
    (folder / "plugins").mkdir()
    (folder / "plugins" / "__init__.py").touch()
    with zipfile.ZipFile(archive) as packed:
        packed.extractall(folder / "plugins")
    return folder


def test_installed_package_builds_the_same_zip(archive, tmp_path):
    """From a plain pip install the plugin's files come with the package."""
    setuptools = pytest.importorskip("setuptools")
    if int(setuptools.__version__.partition(".")[0]) < 64:
        pytest.skip("this setuptools reads no pyproject.toml")
    command = ["setup.py", "-q", "egg_info", "--egg-base", str(tmp_path), "build_py"]
    build = [sys.executable, *command, "--build-lib", str(tmp_path / "lib")]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    code = "from quantify_client.plugin_build import build_plugin; from pathlib import Path;"
    code += f"build_plugin(Path({str(tmp_path)!r}))"
    subprocess.run(
        [
            sys.executable,
            "-I",
            "-c",
            f"import sys; sys.path.insert(0, {str(tmp_path / 'lib')!r}); {code}",
        ],
        check=True,
    )
    assert (tmp_path / "lib" / "quantify_client" / "plugin_files").is_dir()
    assert (tmp_path / "volcalc.zip").read_bytes() == archive.read_bytes()


def names(archive):
    with zipfile.ZipFile(archive) as packed:
        return packed.namelist()


def test_zip_is_the_same_every_time(archive, tmp_path):
    again = build_plugin(tmp_path / "again.zip")
    assert again == tmp_path / "again.zip"
    assert again.read_bytes() == archive.read_bytes()
    assert [path.name for path in tmp_path.iterdir()] == ["again.zip"]


def test_zip_has_one_folder_with_what_webodm_needs_and_no_sources_of_the_panel(archive):
    found = names(archive)
    assert archive.name == "volcalc.zip"
    assert {name.partition("/")[0] for name in found} == {"volcalc"}
    inner = {name.partition("/")[2] for name in found}
    assert inner >= {
        "__init__.py",
        "plugin.py",
        "manifest.json",
        "requirements.txt",
        "worker/entry.py",
    }
    assert inner >= {"quantify_client/pipeline/run.py", "quantify_client/report/page/report.css"}
    bad = re.compile(r"(^|/)(panel|node_modules|__pycache__|demo|tests|\.[^/]*)(/|$)|\.laz$")
    assert [name for name in inner if bad.search(name)] == []
    assert "public/package.json" not in inner  # WebODM would run npm
    assert "public/webpack.config.js" not in inner


def manifest_of(archive):
    with zipfile.ZipFile(archive) as packed:
        return json.loads(packed.read("volcalc/manifest.json"))


def test_manifest_and_package_have_one_version(archive):
    with zipfile.ZipFile(archive) as packed:
        version = packed.read("volcalc/quantify_client/VERSION").decode().strip()
    manifest = manifest_of(archive)["version"].partition("+")[0]
    project = (ROOT / "pyproject.toml").read_text()
    assert f'version = "{manifest}"' in project
    assert version == manifest


def test_the_version_that_an_administrator_sees_names_the_build(archive, monkeypatch, tmp_path):
    """The same files give the same name; one byte more gives another."""
    shown = manifest_of(archive)["version"]
    assert re.fullmatch(r"\d+\.\d+\.\d+\+[0-9a-f]{8}", shown)
    manifest, plugin = plugin_build._sources()
    copy = tmp_path / "copy"
    shutil.copytree(plugin, copy / "plugin", ignore=shutil.ignore_patterns("panel"))
    shutil.copy(manifest, copy)
    monkeypatch.setattr(plugin_build, "_sources", lambda: (copy / manifest.name, copy / "plugin"))
    assert manifest_of(build_plugin(tmp_path))["version"] == shown
    with (copy / "plugin" / "files" / "store.py").open("a") as file:
        file.write("\n")
    assert manifest_of(build_plugin(tmp_path))["version"] != shown


def test_an_administrator_is_told_what_an_upgrade_keeps(archive):
    told = manifest_of(archive)["description"]
    assert "Saved measurements belong to their tasks and stay" in told
    assert "not saved are lost" in told


def test_requirements_are_spelt_as_pip_freeze_spells_them():
    """WebODM compares the names letter by letter, and installs at every start when one differs."""
    lines = (ROOT / "plugin" / "requirements.txt").read_text().splitlines()
    frozen = subprocess.run(
        [sys.executable, "-m", "pip", "freeze", "--all"], capture_output=True, text=True, check=True
    ).stdout
    installed = {line.split("==")[0] for line in frozen.split()}
    asked = [re.split("==|<=|>=|<|>", line)[0] for line in lines]
    assert set(asked) <= installed
    assert all(re.fullmatch(r"[A-Za-z]+(==|>=)[\d.]+(,<\d+)?", line) for line in lines)
    assert "numpy==1.26.2" in lines


def test_nothing_but_webodms_own_is_imported_when_the_plugin_loads():
    """The requirements are installed after that, and else never."""
    seen, waiting = set(), [("plugin",)]
    while waiting:
        package = waiting.pop()
        path = ROOT.joinpath(*package)
        inside = package if path.is_dir() else package[:-1]
        path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        if package in seen or not path.is_file():
            continue  # known already, or a name in a module
        seen.add(package)
        for node in ast.parse(path.read_text()).body:  # at the top, not within functions
            roots = set()
            if isinstance(node, ast.Import):
                roots = {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level:
                there = inside[: len(inside) - node.level + 1]
                there += tuple(node.module.split(".")) if node.module else ()
                if "quantify_client" in there:  # beside the plugin here, inside it in the zip
                    there = there[there.index("quantify_client") :]
                waiting += [there[:place] for place in range(1, len(there) + 1)]
                waiting += [(*there, alias.name) for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                roots = {node.module.partition(".")[0]}
            assert roots <= WEBODM | STANDARD, package
    assert seen >= {("plugin", "web", "starting"), (("plugin", "worker", "entry"))}
    library = {package[1] for package in seen if package[0] == "quantify_client" and package[1:]}
    assert library <= {"types", "errors", "options"}
    assert (("plugin", "worker", "measuring")) not in seen


STANDARD = getattr(sys, "stdlib_module_names", frozenset()) | {
    "__future__",
    *(
        "base64",
        "binascii",
        "contextlib",
        "copy",
        "dataclasses",
        "datetime",
        "errno",
        "fcntl",
        "functools",
        "gc",
        "html",
        "numbers",
    ),
    *("hashlib", "importlib", "inspect", "itertools", "json", "logging", "math", "os", "pathlib"),
    *("re", "shutil", "stat", "sys", "time", "typing", "unicodedata", "uuid"),
}


def run(code, absent, *paths):
    text = MEASURED.format(absent=set(absent), paths=[str(path) for path in paths]) + code
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_measuring_and_its_layers_need_no_drawing_terminal_or_server_packages(unpacked):
    """In WebODM's worker, under the plugin's own package name."""
    (unpacked / "plugins" / "volcalc" / "__init__.py").write_text("")  # without WebODM
    cloud = ROOT / "quantify_client" / "demo" / "brighton_beach.laz"
    areas = ROOT / "quantify_client" / "demo" / "areas.geojson"
    code = (
        "from plugins.volcalc.quantify_client import measure\n"
        "from plugins.volcalc.quantify_client.webmap import clicked\n"
        "from plugins.volcalc.quantify_client.report.document.measurement import to_json\n"
        "from plugins.volcalc.quantify_client.webmap.layers import map_layers\n"
        f"found = measure({str(cloud)!r}, area={str(areas)!r})\n"
        "assert map_layers(found)[0]['relief'], found\n"
        "print(to_json(found)['provenance']['version'])\n"
        "assert 'quantify_client' not in sys.modules\n"
    )
    absent = ("matplotlib", "rich", "requests", "pyodm", "PIL", "pyogrio", "quantify_client")
    absent += ("plyfile",)  # GPL: the plugin reads no PLY
    assert run(code, absent, unpacked) == "0.1.0\n"


def test_exports_need_nothing_that_webodm_has_not(unpacked):
    (unpacked / "plugins" / "volcalc" / "__init__.py").write_text("")
    code = "import plugins.volcalc.quantify_client.report.document.saved_export\n"
    absent = ("shapely", "laspy", "pyproj", "yaml", "scipy", "matplotlib", "rich", "PIL")
    run(code, absent, unpacked)


def test_plyfile_is_in_no_zip_and_in_no_requirement(archive):
    """It is GPL: a requirement of the command alone."""
    with zipfile.ZipFile(archive) as packed:
        assert b"plyfile" not in packed.read("volcalc/requirements.txt")
        assert not any("plyfile" in name for name in packed.namelist())
        imports = [
            name
            for name in packed.namelist()
            if name.endswith(".py")
            and re.search(rb"^\s*(import|from) plyfile", packed.read(name), re.M)
        ]
    assert imports == ["volcalc/quantify_client/cloud/ply/header.py"]  # where a PLY is opened


def play_pip(monkeypatch):
    asked = []

    def pip(command, **kwargs):
        asked.extend(command)
        folder = Path(command[command.index("--target") + 1])
        for name in ("laspy/jobs/demo.py", "laspy/__pycache__/x.pyc", "bin/laspy"):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text("x")
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(plugin_build.subprocess, "run", pip)
    return asked


@pytest.mark.parametrize(
    ("given", "made"),
    [
        ([], ["volcalc-offline.zip", "volcalc.zip"]),
        (["--offline"], ["volcalc-offline.zip"]),
        (["--online"], ["volcalc.zip"]),
    ],
)
def test_the_command_names_first_what_fits_webodms_images(
    monkeypatch, capsys, tmp_path, given, made
):
    play_pip(monkeypatch)
    assert main(["plugin", "--out", str(tmp_path), *given]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [Path(line.partition(" (")[0]).name for line in lines[:-1]] == made
    assert sorted(path.name for path in tmp_path.iterdir()) == made
    assert "restart WebODM" in lines[-1]


def test_a_name_of_one_file_gets_one_file(monkeypatch, tmp_path):
    play_pip(monkeypatch)
    assert main(["plugin", "--out", str(tmp_path / "mine.zip")]) == 0
    assert any("site-packages" in name for name in names(tmp_path / "mine.zip"))


def test_offline_zip_holds_packages_and_the_mark_that_they_are_there(monkeypatch, tmp_path):
    """Without a network: pip is played."""
    asked = play_pip(monkeypatch)
    archive = build_plugin(tmp_path, offline=True)
    assert archive.name == "volcalc-offline.zip"
    packages = {n for n in names(archive) if n.startswith("volcalc/site-packages/")}
    assert packages == {
        "volcalc/site-packages/laspy/jobs/demo.py",
        "volcalc/site-packages/install_md5",
    }
    with zipfile.ZipFile(archive) as packed:
        mark = packed.read("volcalc/site-packages/install_md5").decode()
        wanted = hashlib.md5(packed.read("volcalc/requirements.txt")).hexdigest()  # noqa: S324
    assert mark == wanted
    assert manifest_of(archive) == manifest_of(build_plugin(tmp_path))
    assert {"3.9", "cp39", ":all:", "--no-deps"} <= set(asked)
    assert not any(word.startswith("numpy") for word in asked)


def test_pip_that_fails_is_told(monkeypatch, capsys, tmp_path):
    def pip(command, **kwargs):
        return subprocess.CompletedProcess(command, 1, "", "trouble\nno network\n")

    monkeypatch.setattr(plugin_build.subprocess, "run", pip)
    assert main(["plugin", "--out", str(tmp_path)]) == 1
    [said] = capsys.readouterr().err.splitlines()
    assert "no network" in said
    assert "--online" in said
    assert list(tmp_path.iterdir()) == []
    assert main(["plugin", "--out", str(tmp_path), "--online"]) == 0


def test_folder_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(plugin_build.OutputError, match="cannot be written"):
        build_plugin(tmp_path / "file" / "out")


def test_zip_without_the_built_panel_is_refused(monkeypatch, tmp_path):
    """WebODM would load it and show nothing."""
    (tmp_path / "plugin").mkdir()
    (tmp_path / "manifest.json").write_text("{}")
    monkeypatch.setattr(
        plugin_build, "_sources", lambda: (tmp_path / "manifest.json", tmp_path / "plugin")
    )
    with pytest.raises(plugin_build.OutputError, match=r"public/main\.js is missing"):
        build_plugin(tmp_path)
