"""The WebODM plugin as a zip: volcalc-offline.zip with its requirements inside, or volcalc.zip."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Dict, List, Pattern, Tuple

from .errors import OutputError
from .files.writing import put_in_place, require_replaceable, scratch, staging
from .version import VERSION_FILE, package_version

__all__ = ["NAME", "build_plugin", "replaceable_zip"]

#: The zip's one folder; WebODM makes it the plugin's name and part of its addresses.
NAME = "volcalc"

_PACKAGE = Path(__file__).resolve().parent

# What runs inside WebODM: its Python and the processor that its images are built for.
_TARGET = ("--python-version", "3.9", "--implementation", "cp", "--abi", "cp39")
_PLATFORMS = ("manylinux2014_x86_64", "manylinux_2_17_x86_64", "manylinux_2_28_x86_64")

# The command line and what it alone uses stay out.
_LEFT_OUT = re.compile(
    r"(^|/)(\.[^/]*|__pycache__|demo|plugin_files|commands|jobs|node_modules)(/|$)|\.py[co]$|~$"
    r"|^(__main__|cli|plugin_build)\.py$"
)
_COMPILED = re.compile(r"(^|/)__pycache__/|\.py[co]$")
_PANEL_SOURCES = re.compile(
    r"^(panel|tests)(/|$)|^public/(webpack\.config\.js|package[^/]*\.json)$"
)
_PANEL = ("public/main.js", "public/build/main.js")
_TIME = (1980, 1, 1, 0, 0, 0)

# Of the digest that names a build: eight digits, as a short commit has.
_BUILD_DIGITS = 8

Entries = Dict[str, bytes]


def replaceable_zip(out: Path, *, offline: bool) -> Path:
    """Return where a zip goes; OutputError where something lies there that is none of ours."""
    name = f"{NAME}-offline.zip" if offline else f"{NAME}.zip"
    target = out if out.suffix == ".zip" else out / name
    require_replaceable(target)
    return target


def build_plugin(out: Path, *, offline: bool = False) -> Path:
    """Write the plugin's zip into a folder (or to that ``.zip``), the same bytes every time.

    Parameters
    ----------
    offline : put the requirements inside, for servers without internet: as wheels for Python 3.9 on
        x86-64 Linux, which pip has to fetch now.

    Returns
    -------
    The file. Raises OutputError when something is missing or it cannot be written.
    """
    target = replaceable_zip(out, offline=offline)
    entries = _entries()
    if offline:
        entries.update(_site_packages(entries["requirements.txt"]))
    try:
        with staging(target.parent, make=True) as working:
            _write(working / target.name, entries)
            put_in_place(working, [target.name])
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(
            f"{target} cannot be written: {error.strerror or error}; give another --out"
        ) from error
    return target


def _entries() -> Entries:
    """Return the plugin's files by their names below its folder."""
    manifest, plugin = _sources()
    entries = {"manifest.json": manifest.read_bytes()}
    entries.update({n: data for n, data in _files(plugin).items() if not _PANEL_SOURCES.search(n)})
    missing = [name for name in _PANEL if name not in entries]
    if missing:
        raise OutputError(
            f"the panel is not built: {missing[0]} is missing; build it (plugin/panel), or check "
            "out the committed build"
        )
    library = _files(_PACKAGE)
    library[VERSION_FILE] = f"{package_version()}\n".encode()
    entries.update({f"quantify_client/{name}": data for name, data in library.items()})
    entries["manifest.json"] = _with_build(entries)
    return entries


def _with_build(entries: Entries) -> bytes:
    """Return the manifest with the build in its version: 0.1.0+1a2b3c4d.

    The build is a digest of the plugin's files, so that it is the same wherever the same files are
    packed, also by an installed package that knows no commit.
    """
    digest = hashlib.sha256()
    for name in sorted(entries):
        data = entries[name]
        digest.update(f"{name}\0{len(data)}\0".encode() + data)
    manifest = json.loads(entries["manifest.json"])
    manifest["version"] += f"+{digest.hexdigest()[:_BUILD_DIGITS]}"
    return (json.dumps(manifest, indent=2) + "\n").encode()


def _sources() -> Tuple[Path, Path]:
    """Return manifest.json and the plugin's folder: of a checkout, or of an installed package."""
    for root in (_PACKAGE.parent, _PACKAGE / "plugin_files"):
        manifest, plugin = root / "manifest.json", root / "plugin"
        if manifest.is_file() and (plugin / "plugin.py").is_file():
            return manifest, plugin
    raise OutputError(
        "the plugin's files are not there; build it in a checkout of this project, or install the "
        "package anew"
    )


def _files(folder: Path, left_out: Pattern[str] = _LEFT_OUT) -> Entries:
    names = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*")}
    return {
        name: path.read_bytes()
        for name, path in names.items()
        if path.is_file() and not left_out.search(name)
    }


def _site_packages(requirements: bytes) -> Entries:
    """Return the requirements as WebODM would install them, and the mark that they are there.

    Without dependencies: numpy is WebODM's own, and a second one beside it breaks what was built
    against the first.
    """
    wanted = _wanted(requirements.decode())
    with scratch() as folder:
        target, own = folder / "site", folder / "own"
        own.mkdir()
        command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-compile"]
        command += ["--disable-pip-version-check", "--only-binary", ":all:", *_TARGET]
        for platform in _PLATFORMS:
            command += ["--platform", platform]
        done = subprocess.run(  # noqa: S603 - our own arguments
            [*command, "--target", str(target), *wanted],
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "TMPDIR": str(own)},  # pip cleans up nothing when it is killed
        )
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["pip said nothing"])[-1]
            raise OutputError(
                f"pip could not fetch the plugin's requirements ({last[:200]}); is there a network "
                "connection? --online makes the zip that has WebODM fetch them"
            )
        packages = _files(target, _COMPILED)
    # Commands are of no use there, and name the interpreter of this machine.
    kept = {n: data for n, data in packages.items() if not n.startswith("bin/")}
    kept["install_md5"] = hashlib.md5(requirements).hexdigest().encode()  # noqa: S324 - WebODM's mark
    return {f"site-packages/{name}": data for name, data in kept.items()}


def _wanted(requirements: str) -> List[str]:
    lines = [line.strip() for line in requirements.splitlines() if line.strip()]
    return [line for line in lines if not line.startswith("numpy")] + ["certifi"]


def _write(path: Path, entries: Entries) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in sorted(entries):
            about = zipfile.ZipInfo(f"{NAME}/{name}", date_time=_TIME)
            about.external_attr = 0o644 << 16
            about.create_system = 3  # Unix, also when built on another system
            about.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(about, entries[name])
