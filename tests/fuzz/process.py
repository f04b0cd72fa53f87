"""One command in one process, within limits, and what is wrong with how it ended.

A process is forked from one that has imported everything already, before any thread was started in
it. Memory is bounded twice: RLIMIT_DATA, which counts what is asked for and is what makes a library
abort (RLIMIT_AS would count the libraries and every mapped file as well), and the most that was
resident at any time. Time is the processor's, so that a busy machine makes nothing fail, with a
limit on the clock's for what waits for ever.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import resource
import shutil
import signal
import socket
import sys
import tempfile
import time
import traceback
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence

CPU_S = 20
CLOCK_S = 90
BYTES = 1 << 30

_FORBIDDEN = re.compile(
    r"Traceback|this is a bug|not enough memory|panicked|Panic|\w+Warning\b|Fatal Python"
)
_RESULTS = {"report.json", "scaled-report.html", "gcp_list.txt"}
_LINE = re.compile(r"quantify-client: error: .{15,1500}")
_UNFINISHED = re.compile(r"^\.|\.(part|tmp|new)$")


@dataclass
class Run:
    """A command that has been started; `work` has its inputs, and places for all it may write."""

    number: int
    case: str
    command: Sequence[str]
    work: Path
    pid: int = 0
    started: float = 0.0
    before: Dict[str, str] = field(default_factory=dict)
    expired: bool = False
    honest: bool = False

    def start(self) -> None:
        """Fork, and run the command in the child; return in the parent."""
        made = () if self.command[0] == "volume" else ("out",)  # that makes it itself
        for name in ("cwd", "tmp", *made):
            (self.work / name).mkdir()
        for name in ("stdout", "stderr"):
            (self.work / name).touch()  # also where the child is killed before it opens them
        self.before = _contents(self.work / "in")
        sys.stdout.flush()
        sys.stderr.flush()
        self.started = time.monotonic()
        self.pid = os.fork()
        if not self.pid:
            _child(self.work, self.command)

    def expire(self) -> None:
        """Kill it when it has had its time."""
        if time.monotonic() - self.started > CLOCK_S and not self.expired:
            self.expired = True
            os.killpg(self.pid, signal.SIGKILL)

    def faults(self, status: int, used: Any) -> List[str]:
        """Say what is wrong with how it ended: nothing, as a rule."""
        code = os.waitstatus_to_exitcode(status)
        out, err = ((self.work / n).read_text("utf-8", "replace") for n in ("stdout", "stderr"))
        seconds = used.ru_utime + used.ru_stime
        found = []
        if self.expired or code == -signal.SIGXCPU or seconds > CPU_S:
            found.append(f"took more than {CPU_S} s ({seconds:.0f} s, or waited for ever)")
        elif code not in (0, 1, 2):
            found.append(f"ended with {code}")
        elif self.honest and code and self.command[0] != "resume":  # its server refuses
            found.append("refuses what is right")
        if used.ru_maxrss * 1024 > BYTES:
            found.append(f"took {used.ru_maxrss // 1024} MB")
        found += self._said(code, out, err)
        found += self._left(code)
        return found

    def _said(self, code: int, out: str, err: str) -> List[str]:
        found = [f"says {m.group(0)!r}" for m in [_FORBIDDEN.search(err + out)] if m]
        # Progress of a job, and one line for each area that could not be measured, are told, too.
        lines = [line for line in err.splitlines() if line.strip()]
        errors = [line for line in lines if _LINE.fullmatch(line)]
        if code in (1, 2) and not errors:
            found.append("says no error in one line")
        if self.command[0] != "resume" and len(errors) < len(lines):
            found.append("says more than errors on stderr")
        if self.command[0] in ("info", "scale", "gcp") and len(errors) > 1:
            found.append("says more than one line")
        if code == 0 and errors:
            found.append("succeeds with an error")
        if "--json" in self.command and out and not _is_json(out):
            found.append("gives no JSON")
        return found

    def _left(self, code: int) -> List[str]:
        found = [f"leaves {name} in TMPDIR" for name in _contents(self.work / "tmp")]
        found += [f"leaves {name} in its folder" for name in _contents(self.work / "cwd")]
        made = _contents(self.work / "out") if (self.work / "out").exists() else {}
        names = {Path(name).name for name in made}
        found += [f"leaves {name}" for name in names if _UNFINISHED.search(name)]
        if names and not names & _RESULTS:
            found.append(f"leaves half of a result: {sorted(names)}")
        if code == 0 and "--out" in self.command and not names:
            found.append("succeeds without a result")
        if self.command[0] != "resume":
            after = _contents(self.work / "in")
            names = {*after, *self.before}
            found += [f"changes {n}" for n in names if after.get(n) != self.before.get(n)]
        return found


def _contents(folder: Path) -> Dict[str, str]:
    """Every file and folder below, with a digest of what it holds."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        found[name] = hashlib.sha1(path.read_bytes()).hexdigest() if path.is_file() else ""  # noqa: S324
    return found


def _is_json(text: str) -> bool:
    def constant(word: str) -> None:
        raise ValueError(word)

    try:
        json.loads(text, parse_constant=constant)
    except ValueError:
        return False
    return True


def _child(work: Path, command: Sequence[str]) -> None:
    """Be the command; never return."""
    code = 70
    try:
        os.setsid()
        os.chdir(work / "cwd")
        for handle, name in ((1, "stdout"), (2, "stderr")):
            os.dup2(os.open(work / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), handle)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.environ["TMPDIR"] = str(work / "tmp")
        tempfile.tempdir = None
        for limit, most in _LIMITS.items():
            resource.setrlimit(limit, (most, most))
        _stay_here()
        from quantify_client.cli import main

        code = main(list(command))
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:  # it is what is looked for
        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(code)


_LIMITS = {
    resource.RLIMIT_DATA: BYTES,
    resource.RLIMIT_FSIZE: BYTES,
    resource.RLIMIT_CPU: CPU_S,
    resource.RLIMIT_CORE: 0,
}


def _stay_here() -> None:
    """Let nothing leave this machine, whatever a damaged journal names."""
    for scheme in ("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY"):
        os.environ[scheme] = "http://127.0.0.1:9"  # for libraries that ask the network themselves
    resolve = socket.getaddrinfo

    def only_here(host: Any, *rest: Any, **more: Any) -> Any:
        if host not in ("127.0.0.1", "localhost", "::1"):
            raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")
        return resolve(host, *rest, **more)

    socket.getaddrinfo = only_here


def keep(run: Run, folder: Path, faults: Sequence[str]) -> Optional[Path]:
    """Put a failing run's inputs and words where somebody can look at them."""
    kept = folder / f"{run.number}-{run.case}"
    shutil.rmtree(kept, ignore_errors=True)
    shutil.copytree(run.work, kept, symlinks=True)
    text = "\n".join([f"cd {kept / 'cwd'}", " ".join(("quantify-client", *run.command)), *faults])
    (kept / "README.txt").write_text(text + "\n")
    return kept
