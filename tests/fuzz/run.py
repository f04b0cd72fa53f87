"""Give damaged inputs to the real command: ``python tests/fuzz/run.py --runs 2000 --seed 1``.

Each run is one command on one input of which one file, sometimes two, is damaged; it has to end
in 20 s and 1 GB with exit status 0, 1 or 2, one line on stderr that is no bug's, and nothing left
behind.
The same seed and number give the same damage: ``--seed 1 --only 17`` repeats one run.
"""

from __future__ import annotations

import argparse
import gc
import importlib
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path
from random import Random
from typing import Dict, List, Sequence

# Before numpy: a process that has threads must not be forked.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
os.environ["MPLBACKEND"] = "Agg"
HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parents[1]), str(HERE.parents[2])]

from fuzz.inputs import Case, write_cases  # noqa: E402
from fuzz.mutations import damage  # noqa: E402
from fuzz.process import Run, keep  # noqa: E402

_LATE = (
    *("laspy", "pyogrio.raw", "scipy.spatial", "quantify_client.cli"),
    *("quantify_client.commands.jobs", "quantify_client.report.page.page"),
)


def main() -> int:
    """Run, and return 1 when something is wrong."""
    given = _parser().parse_args()
    numbers = given.only or range(given.first, given.first + given.runs)
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name:
        root = Path(name).resolve()
        cases = _made(root / "inputs")
        if given.honest:  # a case for each command, so that each is run once
            cases = [Case(c.name, c.targets, (line,)) for c in cases for line in c.commands]
            numbers = range(0, len(cases), given.every)
        _warm()
        failed = _all(cases, root, given, numbers)
    print(f"{len(numbers)} runs of seed {given.seed}: {len(failed)} failed")
    return 1 if failed else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, metavar="K", help="number of the first run")
    parser.add_argument("--honest", action="store_true", help="damage nothing: all must succeed")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="of those, each Nth")
    parser.add_argument("--only", type=int, action="append", metavar="K", help="this run alone")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"), metavar="DIR")
    return parser


def _made(root: Path) -> List[Case]:
    """Write the inputs, in a process of its own: what compresses and draws starts threads."""
    names = root.with_suffix(".txt")
    if not os.fork():
        try:
            names.write_text(repr(write_cases(root)))
            os._exit(0)
        except BaseException:
            sys.excepthook(*sys.exc_info())
        finally:
            os._exit(1)
    if os.wait()[1]:
        raise SystemExit("the inputs cannot be made, see above")
    return list(eval(names.read_text(), {"Case": Case}))  # noqa: S307 - written above


def _warm() -> None:
    """Import what commands import late, and have matplotlib find its fonts."""
    import matplotlib.pyplot as plt

    for name in _LATE:
        importlib.import_module(name)
    figure = plt.figure()
    figure.add_subplot().set_title("A")
    figure.canvas.draw()
    plt.close(figure)
    # It stays: the collector of a forked process need not look at it, which would copy it.
    gc.collect()
    gc.freeze()


def _all(
    cases: Sequence[Case], root: Path, given: argparse.Namespace, numbers: Sequence[int]
) -> List[int]:
    going: Dict[int, Run] = {}
    failed: List[int] = []
    waiting = list(reversed(numbers))
    while waiting or going:
        if waiting and len(going) < given.jobs:
            run = prepared(cases, root, given, waiting.pop())
            run.start()
            going[run.pid] = run
            continue
        pid, status, used = os.wait4(-1, os.WNOHANG)
        if not pid:
            time.sleep(0.002)
            for run in going.values():
                run.expire()
            continue
        run = going.pop(pid)
        faults = run.faults(status, used)
        if faults:
            failed.append(run.number)
            _tell(run, faults, given)
        shutil.rmtree(run.work)
    return failed


def _tell(run: Run, faults: Sequence[str], given: argparse.Namespace) -> None:
    kept = keep(run, given.keep.resolve(), faults)
    last = (run.work / "stderr").read_text("utf-8", "replace").strip().splitlines()[-1:]
    print(f"run {run.number} ({run.case}: {' '.join(run.command)}): {'; '.join(faults)}")
    print(f"    {''.join(last)[:300]}")
    print(f"    again: --seed {given.seed} --only {run.number}; kept: {kept}", flush=True)


def prepared(cases: Sequence[Case], root: Path, given: argparse.Namespace, number: int) -> Run:
    """Choose an input, a command and the damage by seed and number alone."""
    random = Random(f"{given.seed}-{number}")
    case = cases[number % len(cases)]
    work = root / f"run-{number}"
    shutil.copytree((root / "inputs" / case.name).resolve(), work / "in")
    if given.honest:
        return Run(number, case.name, case.commands[0], work, honest=True)
    others = [(work / "in" / name).read_bytes() for name in case.targets]
    other = random.choice(cases)
    others.append((root / "inputs" / other.name / random.choice(other.targets)).read_bytes())
    for name in random.sample(list(case.targets), min(len(case.targets), random.choice((1, 1, 2)))):
        path = work / "in" / name
        if random.random() < 0.01:
            path.unlink()
            continue
        path.write_bytes(damage(name, path.read_bytes(), random, others))
    return Run(number, case.name, random.choice(case.commands), work)


if __name__ == "__main__":
    sys.exit(main())
