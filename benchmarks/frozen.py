"""Frozen results: what the command of one checkout finds, compared with that of another.

    python benchmarks/frozen.py run TREE --out table.json [--python PY] [--only NAME...]
    python benchmarks/frozen.py compare before.json after.json [--within 1e-9]

`run` measures small inputs with a known seed (frozen_inputs.py) and the bundled example by
``PY -m quantify_client``, and writes every number that the JSON documents hold. `compare` says for
each case whether the numbers are the same. Nothing is imported from the checkout, so that any two
can be compared, also across moves and renames. See `LEFT_OUT` and `TEXTS` for what is compared.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, Sequence, Tuple

import frozen_inputs
import laspy
import numpy as np

Table = Dict[str, Dict[str, Any]]
"""By case: the exit status and, with status 0, the values by path."""

LEFT_OUT = {"schema", "provenance", "warnings", "files", "out", "areas", "can", "cannot"}
"""Keys below which nothing is compared: times, paths and wording."""

TEXTS = {"shape", "method", "mode", "crs", "target_crs", "length_unit", "format", "base", "name"}
TEXTS |= {"source", "kind", "from", "to", "point", "component"}
"""Keys whose texts are compared; all other texts are wording."""

FLOOR = 1e-3
"""Differences between values smaller than this (a millimetre, a litre) are relative to it."""

MOST_SECONDS = 600
CRASHES = re.compile("Traceback|this is a bug")

DEMO = "volume brighton_beach.laz --area areas.geojson"
HEAP = "volume heap.las --area heap.geojson --base triangulate"
TERRAIN = {
    "demo command": "demo",
    "demo triangulate": f"{DEMO} --base triangulate",
    "demo plane": f"{DEMO} --base plane",
    "demo average": f"{DEMO} --base average",
    "demo lowest": f"{DEMO} --base lowest",
    "demo highest": f"{DEMO} --base highest",
    "demo elevation": f"{DEMO} --base 160.5",
    "demo compare": f"{DEMO} --base compare",
    "demo slices": f"{DEMO} --base plane --slices 7",
    "demo slice height": f"{DEMO} --base plane --slice-height 0.25",
    "demo density": f"{DEMO} --base triangulate --density 1.6:0.1",
    "demo grid": f"{DEMO} --base triangulate --grid",
    "demo 1 thread": f"{DEMO} --base triangulate --threads 1",
    "demo 4 threads": f"{DEMO} --base triangulate --threads 4",
    "heap las": HEAP,
    "heap default base": "volume heap.las --area heap.geojson",
    "heap compare": "volume heap.las --area heap.geojson --base compare",
    "heap laz tilted": "volume plain.laz --area heap.geojson --base plane",
    "heap csv": "volume heap.csv --area no-crs.geojson --base triangulate",
    "heap two tiles": "volume west.laz east.laz --area heap.geojson --base triangulate",
    "heap duplicates": "volume twice.las --area heap.geojson --base triangulate",
    "heap heights in feet": "volume heights.las --vertical-unit ft --area heap.geojson"
    " --base triangulate",
    "heap area in degrees": "volume heap.las --area degrees.geojson --base triangulate",
    "heap area with a hole": "volume heap.las --area hole.geojson --base triangulate",
    "heap area off the cloud": "volume heap.las --area off.geojson --base triangulate",
    "heap area far away": "volume heap.las --area far.geojson --base triangulate",
    "heap report": f"{HEAP} --out OUT",
    "heap without area": "volume heap.las --base lowest",
    "heap without crs": "volume heap.csv --shape terrain --base plane",
    "feet stated": "volume feet.las --area feet.geojson --base triangulate",
    "feet given": "volume feet.xyz --crs EPSG:2229 --vertical-unit us-ft --area feet.geojson"
    " --base triangulate",
    "degrees": "volume degrees.las --area heap.geojson --base triangulate",
    "pit ply": f"volume pit.ply --crs {frozen_inputs.UTM} --area heap.geojson --base triangulate",
    "gully xyz": "volume gully.xyz --area gully.geojson --base triangulate"
    f" --crs {frozen_inputs.UTM}",
    "two areas": "volume both.las --area both.geojson --base triangulate --slices 5",
}
BODIES = {
    "sphere": "volume sphere.laz --source-unit m",
    "sphere slices": "volume sphere.laz --slices 10",
    "sphere slice height": "volume sphere.laz --slice-height 0.15",
    "sphere density": "volume sphere.laz --density 2.4:0.1",
    "sphere polar": "volume sphere.laz --method polar",
    "sphere polar slices": "volume sphere.laz --method polar --slices 20",
    "sphere polar caps": "volume sphere.laz --method polar --center-caps",
    "sphere half below": "volume sphere.laz --floor 100",
    "millimetres": "volume millimetres.xyz --source-unit mm",
    "cube": "volume cube.las",
    "torus": "volume torus.ply",
    "cup": "volume cup.laz",
    "cup hollow": "volume cup.laz --hollow",
    "shell hollow": "volume shell.laz --hollow",
    "two bodies": "volume two.laz",
    "noisy": "volume noisy.laz",
    "thinned": "volume thinned.xyz",
    "standing": "volume standing.laz",
    "standing on a plane": "volume standing.laz --floor plane",
    "standing on an elevation": "volume standing.laz --floor 99.52",
    "standing on none": "volume standing.laz --floor none",
    "holed": "volume holed.laz",
    "holed gap": "volume holed.laz --max-gap 0.3",
    "holed small gap": "volume holed.laz --max-gap 0.1",
    "dome": "volume dome.laz",
    "dome on an elevation": "volume dome.laz --floor 100",
}
MESHES = {
    "tetrahedron": "volume tetrahedron.ply",
    "icosphere": "volume icosphere.ply --source-unit m --slices 12",
    "icosphere accuracy": "volume icosphere.ply --accuracy 0.01",
    "icosphere on a grid": f"volume icosphere.ply --crs {frozen_inputs.UTM} --shape object",
    "open mesh": "volume open.ply",
    "crossing mesh": "volume crossing.ply",
    "hollow mesh": "volume hollow.ply --hollow",
}
CONTROL = {
    "scale tapes": "scale site.las --gcp tapes.json",
    "scale phone": "scale site.las --gcp phone.yaml",
    "scale only": "scale site.las --gcp levelled.yaml --scale-mode scale",
    "scale shift": "scale site.las --gcp levelled.yaml --scale-mode shift",
    "scale full": "scale site.las --gcp levelled.yaml --scale-mode full",
    "scale positions": "scale site.las --gcp positions.json",
    "scale bars": "scale sphere.laz --gcp bars.json",
    "scale wrong tape": "scale site.las --gcp wrong.json",
    "scale checks": "scale site.las --gcp checked.yaml",
    "scale tables": "scale site.las --gcp tables.yaml",
    "scale feet": "scale site.las --gcp feet.json",
    "scale own frame": "scale own.xyz --gcp own.yaml",
    "scale written": "scale site.las --gcp levelled.yaml --area site.geojson --out OUT/scaled.laz",
    "scale own frame written": "scale own.xyz --gcp own.yaml --out OUT/scaled.laz",
    "volume control": "volume site.las --gcp phone.yaml --area site.geojson --base triangulate",
    "volume control full": "volume site.las --gcp levelled.yaml --scale-mode full --base plane"
    " --area site.geojson",
    "volume surveyed areas": "volume site.las --gcp levelled.yaml --area surveyed.geojson"
    " --area-frame control --base 100.5",
    "volume own frame": "volume own.xyz --gcp own.yaml --area surveyed.geojson"
    " --area-frame control --base triangulate",
    "volume bars": "volume sphere.laz --gcp bars.json",
    "gcp places": "gcp levelled.yaml",
    "gcp design": "gcp design.yaml",
    "gcp wrong tape": "gcp wrong.json",
    "gcp list": "gcp gcp_list.txt",
    "gcp odm": "gcp odm.yaml --to odm --out OUT/odm.txt",
}
INFO = {
    "info demo": "info brighton_beach.laz",
    "info feet": "info feet.las",
    "info degrees": "info degrees.las",
    "info standing": "info standing.laz",
    "info mesh": "info icosphere.ply",
    "info tiles": "info west.laz east.laz",
}
CASES = {**TERRAIN, **BODIES, **MESHES, **CONTROL, **INFO}


# --- run


def run(options: argparse.Namespace) -> int:
    """Run the cases and write the table; return 1 when one crashed or was a wrong usage."""
    unknown = sorted(set(options.only or ()) - set(CASES))
    if unknown:
        raise SystemExit(f"no case is called {', '.join(unknown)}; there are: {', '.join(CASES)}")
    names = options.only or list(CASES)
    tree = options.tree.resolve()
    environment = environment_of(tree)
    with ExitStack() as stack:
        folder = options.dir or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(parents=True, exist_ok=True)
        python = str(Path(shutil.which(options.python) or options.python).absolute())
        about = describe(python, tree, folder, environment)
        prepare(folder, tree)
        one = partial(result_of, python=python, folder=folder, environment=environment)
        with ThreadPoolExecutor(options.jobs) as pool:
            table: Table = dict(zip(names, pool.map(one, names)))
    options.out.write_text(json.dumps({**about, "cases": table}, indent=1), encoding="utf-8")
    bad = [name for name in names if table[name]["status"] not in (0, 1)]
    if bad:
        print(f"not a result: {', '.join(bad)}", file=sys.stderr)
    return 1 if bad else 0


def environment_of(tree: Path) -> Dict[str, str]:
    """Return the environment of a run: the checkout's package, and sums in one order."""
    return {
        **os.environ,
        "PYTHONPATH": str(tree),
        "PYTHONDONTWRITEBYTECODE": "1",
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "MPLBACKEND": "Agg",
    }


def prepare(folder: Path, tree: Path) -> None:
    """Make the inputs, unless the folder has those of this version of the script."""
    mark = folder / "made-by"
    version = hashlib.sha256(Path(frozen_inputs.__file__).read_bytes()).hexdigest()
    if mark.exists() and mark.read_text(encoding="utf-8") == version:
        return
    frozen_inputs.make_inputs(folder)
    for name in ("brighton_beach.laz", "areas.geojson"):
        shutil.copyfile(next((tree / "quantify_client").rglob(name)), folder / name)
    mark.write_text(version, encoding="utf-8")


def describe(python: str, tree: Path, folder: Path, environment: Dict[str, str]) -> Dict[str, str]:
    """Return what the table is of, or stop when another package than the tree's would run."""
    code = (
        "import sys, numpy, scipy, shapely, pyproj, quantify_client as q;"
        "print(q.__file__);"
        "print(sys.version.split()[0], *(f'{m.__name__} {m.__version__}' for m in "
        "(numpy, scipy, shapely, pyproj)), sep=', ')"
    )
    done = subprocess.run(
        [python, "-c", code],
        env=environment,
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    package, versions = done.stdout.splitlines()
    if tree not in Path(package).resolve().parents:
        raise SystemExit(f"{python} would run {package}, not the package in {tree}")
    return {"tree": str(tree), "environment": f"Python {versions}"}


def result_of(name: str, python: str, folder: Path, environment: Dict[str, str]) -> Dict[str, Any]:
    """Run one case and return its exit status and its values."""
    out = folder / "out" / name.replace(" ", "-")
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    words = shlex.split(CASES[name].replace("OUT", f"out/{out.name}"))
    start = time.perf_counter()
    done = subprocess.run(
        [python, "-m", "quantify_client", *words, "--json"],
        env=environment,
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=MOST_SECONDS,
        check=False,
    )
    crashed = CRASHES.search(done.stderr) is not None
    said = done.stderr.strip().splitlines()[-1:] if done.returncode else [""]
    seconds = time.perf_counter() - start
    print(f"{seconds:6.1f} s  {done.returncode}  {name}  {''.join(said)[:150]}", file=sys.stderr)
    if done.returncode or crashed:
        return {"status": "crash" if crashed else done.returncode}
    return {"status": 0, "values": values_of(done.stdout, out)}


def values_of(stdout: str, out: Path) -> Dict[str, Any]:
    """Return what is compared, by path: of the document, and of the files that were written."""
    document = json.loads(stdout)
    document.pop("source", None)
    values = dict(leaves(document))
    for path in sorted(out.rglob("*")):
        values.update(leaves(content_of(path), f"written/{path.name}"))
    return values


def leaves(value: Any, path: str = "") -> Iterator[Tuple[str, Any]]:
    """Yield the path and the value of every number, flag, null and text that is compared.

    The length of a list is a value too, so that a list which grew is no mere addition of keys.
    """
    below = f"{path}/" if path else ""
    if isinstance(value, Mapping):
        for key, item in value.items():
            if key not in LEFT_OUT:
                yield from leaves(item, f"{below}{key}")
    elif isinstance(value, (list, tuple)):
        yield f"{below}#", len(value)
        for index, item in enumerate(value):
            yield from leaves(item, f"{below}{index}")
    elif not isinstance(value, str) or path.rpartition("/")[2] in TEXTS:
        yield path, value


def content_of(path: Path) -> Any:
    """Return the numbers of a file that was written; nothing of pages and pictures."""
    if path.suffix == ".laz":
        points = np.asarray(laspy.read(path).xyz)
        summary = {"points": len(points), "low": points.min(axis=0), "high": points.max(axis=0)}
        summary.update(mean=points.mean(axis=0), std=points.std(axis=0))
        return {key: np.asarray(value).tolist() for key, value in summary.items()}
    if path.suffix == ".geojson":
        return json.loads(path.read_text(encoding="utf-8"))
    if path.suffix in (".txt", ".csv"):
        return [number for word in path.read_text().split() for number in numbers_in(word)]
    return {}


def numbers_in(word: str) -> List[float]:
    """Return the numbers in comma-separated text."""
    return [float(part) for part in word.split(",") if re.fullmatch(r"-?\d+\.?\d*(e-?\d+)?", part)]


# --- compare


def compare(options: argparse.Namespace) -> int:
    """Print a line for each case; return 1 unless all are equal."""
    before, after = (
        json.loads(path.read_text(encoding="utf-8")) for path in (options.before, options.after)
    )
    for table in (before, after):
        print(f"{table['tree']}: {len(table['cases'])} cases, {table['environment']}")
    renamed = dict(pair.split("=", 1) for pair in options.renamed)
    wrong = 0
    for name in {**before["cases"], **after["cases"]}:
        first, second = before["cases"].get(name), after["cases"].get(name)
        if first is None or second is None:
            equal, said = False, f"missing {'before' if first is None else 'after'}"
        else:
            equal, said = judged(first, second, renamed, options.within)
        wrong += not equal
        print(f"{'  ' if equal else '! '}{name}: {said}")
    for when, names in zip(("before", "after"), alone(before["cases"], after["cases"], renamed)):
        if names:
            print(f"keys only {when}: {', '.join(names)}")
    print(f"{wrong} of {len({**before['cases'], **after['cases']})} cases are not equal")
    return 1 if wrong else 0


def judged(
    before: Mapping[str, Any],
    after: Mapping[str, Any],
    renamed: Mapping[str, str],
    within: float,
) -> Tuple[bool, str]:
    """Return whether two results of a case are equal, and how they differ."""
    if before["status"] != after["status"]:
        return False, f"exit status {before['status']} -> {after['status']}"
    if before["status"] != 0:
        return True, f"equal (exit status {before['status']})"
    first = {rename(path, renamed): value for path, value in before["values"].items()}
    second: Mapping[str, Any] = after["values"]
    shared = [path for path in first if path in second]
    lost, new = len(first) - len(shared), len(second) - len(shared)
    note = f"; not compared: {lost} keys only before, {new} only after" if lost or new else ""
    apart = {path: difference(first[path], second[path]) for path in shared}
    differing = [path for path in shared if first[path] != second[path]]
    if not differing:
        return bool(shared), f"{'equal' if shared else 'no key in common'} ({len(shared)}){note}"
    worst = max(differing, key=apart.__getitem__)
    equal = apart[worst] <= within
    return equal, (
        f"{'within' if equal else 'DIFFERS'}: {len(differing)} of {len(shared)}, the most by "
        f"{apart[worst]:.2g} at {worst}: {first[worst]} -> {second[worst]}{note}"
    )


def alone(before: Table, after: Table, renamed: Mapping[str, str]) -> Tuple[List[str], List[str]]:
    """Return the keys that one side has and the other never, with ``*`` for the list indices."""
    shared = [name for name in before if name in after]
    first, second = (
        {
            re.sub(r"(?<=/)\d+(?=/|$)", "*", rename(path, names))
            for name in shared
            for path in table[name].get("values", {})
        }
        for table, names in ((before, renamed), (after, {}))
    )
    return sorted(first - second), sorted(second - first)


def rename(path: str, renamed: Mapping[str, str]) -> str:
    """Return a path with its components renamed."""
    return "/".join(renamed.get(part, part) for part in path.split("/"))


def difference(first: Any, second: Any) -> float:
    """Return the relative difference of two numbers; infinity where either is none."""
    if first == second:
        return 0.0
    if any(isinstance(v, bool) or not isinstance(v, (int, float)) for v in (first, second)):
        return float("inf")
    return float(abs(first - second) / max(abs(first), abs(second), FLOOR))


def main(arguments: Sequence[str] = ()) -> int:
    """Parse the command line and run one of the two commands."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(required=True)
    add = commands.add_parser("run", help="measure with a checkout").add_argument
    add("tree", type=Path, metavar="TREE", help="checkout whose quantify_client is run")
    add("--out", type=Path, required=True, help="where the table goes")
    add("--python", default=sys.executable, metavar="PY")
    add("--only", nargs="+", metavar="NAME", help="cases to run (default: all)")
    add("--jobs", type=int, default=2)
    add("--dir", type=Path, help="where the inputs are made, kept, and used again")
    commands.choices["run"].set_defaults(command=run)
    add = commands.add_parser("compare", help="compare two tables").add_argument
    add("before", type=Path)
    add("after", type=Path)
    add("--within", type=float, default=0.0, help="largest relative difference (default 0)")
    add("--renamed", action="append", default=[], metavar="OLD=NEW", help="of path components")
    commands.choices["compare"].set_defaults(command=compare)
    options = parser.parse_args(arguments or None)
    status: int = options.command(options)
    return status


if __name__ == "__main__":
    sys.exit(main())
