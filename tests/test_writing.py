"""Files appear together and in turn, whoever is killed meanwhile and whoever else writes there."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from quantify_client.errors import OutputError
from quantify_client.files import writing
from quantify_client.files.writing import is_ours, put_in_place, require_replaceable, staging

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="locks of folders")

NAMES = ["slices.csv", "report.json", "areas.geojson"]
HEADS = {
    "slices.csv": b"name,z_m,height_m,area_m2,volume_m3,points\r\n",
    "report.json": b'{\n  "schema": "quantify-client/1",\n',
    "areas.geojson": b'{\n  "type": "FeatureCollection",\n  "generator": "quantify-client",\n',
}


def write(folder: Path, text: str) -> None:
    with staging(folder) as working:
        for name in NAMES:
            (working / name).write_bytes(HEADS[name] + text.encode())
        put_in_place(working, NAMES)


def contents(folder: Path) -> list[str]:
    return [(folder / n).read_bytes()[len(HEADS[n]) :].decode() for n in NAMES]


def process(code: str, *arguments: object) -> subprocess.Popen[bytes]:
    here = str(Path(__file__).parent)
    code = f"import sys; sys.path.insert(0, {here!r})\nfrom test_writing import *\n{code}"
    return subprocess.Popen([sys.executable, "-c", code, *map(str, arguments)])


def test_results_of_two_runs_at_once_do_not_mix(tmp_path: Path) -> None:
    code = "for n in range(60): write(Path(sys.argv[1]), f'{sys.argv[2]} {n}' * 1000)"
    both = [process(code, tmp_path, name) for name in ("a", "b")]
    seen = set()
    while any(one.poll() is None for one in both):
        with writing._turn(tmp_path):
            found = contents(tmp_path) if (tmp_path / NAMES[-1]).exists() else [""]
        assert len(set(found)) == 1
        seen.add(found[0])
    assert [one.wait() for one in both] == [0, 0]
    assert len(seen) > 2
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(NAMES)


KILLED = """
move, moves = Path.replace, []
def kill(self, target):
    if len(moves) == int(sys.argv[2]):
        os.kill(os.getpid(), signal.SIGKILL)
    moves.append(target)
    return move(self, target)
Path.replace = kill
write(Path(sys.argv[1]), "new")
"""


@pytest.mark.parametrize("earlier", [False, True])
@pytest.mark.parametrize("moved", [0, 1, 2])
def test_a_run_that_is_killed_among_its_moves_is_ended_by_the_next(
    moved: int, earlier: bool, tmp_path: Path
) -> None:
    if earlier:
        write(tmp_path, "old")
    assert process(KILLED, tmp_path, moved).wait() == -signal.SIGKILL
    assert len(list(tmp_path.glob(".quantify-*"))) == 1
    with pytest.raises(OutputError, match="no earlier"), staging(tmp_path):
        raise OutputError("no earlier")  # whatever the next run does
    assert contents(tmp_path) == ["new"] * 3
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(NAMES)


def test_what_was_put_there_since_is_not_replaced_by_a_killed_run(tmp_path: Path) -> None:
    write(tmp_path, "old")
    process(KILLED, tmp_path, 1).wait()
    mine = {"report.json": b"mine", "areas.geojson": HEADS["areas.geojson"] + b"edited since"}
    for name, text in mine.items():
        (tmp_path / name).write_bytes(text)
    with staging(tmp_path):
        assert {name: (tmp_path / name).read_bytes() for name in mine} == mine


def test_only_folders_of_ours_are_swept(tmp_path: Path) -> None:
    mine = [".quantify-notes", "quantify-0123456789abcdef", ".quantify-0123456789ABCDEF"]
    for name in mine:
        (tmp_path / name).mkdir()
    dead, linked = tmp_path / ".quantify-0123456789abcdef", tmp_path / ".quantify-fedcba9876543210"
    dead.mkdir()
    (tmp_path / "elsewhere").mkdir()
    linked.symlink_to(tmp_path / "elsewhere")
    with staging(tmp_path) as first, staging(tmp_path) as second:
        assert first != second
        assert first.is_dir()
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        [*mine, "elsewhere", linked.name]
    )


def test_a_folder_that_another_program_has_locked_is_waited_for_and_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import fcntl

    monkeypatch.setattr(writing, "_TURN_S", 0.1)
    handle = os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    with pytest.raises(OutputError, match="another run writes into it"):
        write(tmp_path, "new")
    os.close(handle)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("content", "ours"),
    [
        *((head, True) for head in HEADS.values()),
        (b"LASF" + bytes(54) + b"quantify-client\0", True),
        (b"EPSG:32611\n# quantify-client\n1 2 3 4 5 a.jpg A\n", True),
        (b"LASF" + bytes(54) + b"laspy\0", False),
        (b"EPSG:32611\n1 2 3 4 5 a.jpg A\n# quantify-client\n", False),
        (b"name,z_m,height_m,area_m2,volume_m3,points,mine\r\n", False),
        (b'{"type": "FeatureCollection", "features": [], "generator": "quantify-client"}', False),
        (b'{"generator": "quantify-client"}', False),
        (b"<!doctype html><p>quantify-client", False),
        (b"\x89PNG\r\n\x1a\n", False),
        (b"", False),
    ],
)
def test_what_is_ours_is_known_by_what_is_inside(
    content: bytes, ours: bool, tmp_path: Path
) -> None:
    path = tmp_path / "file"
    path.write_bytes(content)
    assert is_ours(path) == ours
    if ours:
        require_replaceable(path, [None, tmp_path / "gone", tmp_path])
        with pytest.raises(OutputError, match="input itself"):
            require_replaceable(path, [tmp_path / "." / "file"])
    else:
        with pytest.raises(OutputError, match="no earlier result"):
            require_replaceable(path)


@pytest.mark.parametrize(
    "plan", [b"5", b"null", b"[1]", b'["a\\u0000b", ".."]', b'{"a": 1}', b"[" * 99_999, b"\xff"]
)
def test_a_working_folder_that_is_none_of_ours_is_swept_without_a_word(
    tmp_path: Path, plan: bytes
) -> None:
    left = tmp_path / ".quantify-0123456789abcdef"
    left.mkdir()
    (left / ".quantify-plan").write_bytes(plan)
    write(tmp_path, "new")
    assert contents(tmp_path) == ["new"] * 3
    assert not left.exists()


def test_a_plan_that_is_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    left = tmp_path / ".quantify-0123456789abcdef"
    left.mkdir()
    os.mkfifo(left / ".quantify-plan")
    write(tmp_path, "new")
    assert not left.exists()


def test_folders_that_cannot_be_locked_are_made_once(tmp_path: Path, monkeypatch) -> None:
    tried = []

    def unlockable(handle: int, operation: int) -> None:
        tried.append(handle)
        assert len(tried) < 3, "another folder each time"
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr("fcntl.flock", unlockable)
    with staging(tmp_path) as working:
        assert list(tmp_path.iterdir()) == [working]
    assert list(tmp_path.iterdir()) == []
