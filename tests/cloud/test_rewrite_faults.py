"""A cloud written through a move: what goes wrong is said, and leaves nothing behind."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from clouds import points, write_las
from hypothesis import given
from hypothesis import strategies as st
from rewriting import UTM, box, move, moved

from quantify_client.cloud.writing import las_file, rewrite, rewrite_cloud
from quantify_client.errors import CloudError, OutputError
from quantify_client.types import Bounds


@pytest.mark.parametrize("ending", [".las", ".laz"])
@pytest.mark.parametrize("keep", [0.999, 0.5, 0.02])
def test_truncated_input_leaves_nothing(ending: str, keep: float, tmp_path: Path) -> None:
    path = write_las(tmp_path / f"a{ending}", points(5000))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * keep)])
    with pytest.raises(CloudError, match="truncated.*again"):
        rewrite_cloud([path], tmp_path / "out.laz", move, box(moved(points())), UTM)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("ending", ["las", "laz"])
@pytest.mark.parametrize("fault", [KeyboardInterrupt, CloudError("damaged"), OSError(28, "full")])
def test_interruption_leaves_what_was_there(
    fault: Any, ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rewrite, "_CHUNK", 1000)
    path, out = write_las(tmp_path / "a.laz", points(5000)), tmp_path / f"out.{ending}"
    earlier = b"LASF" + bytes(54) + b"quantify-client\0 earlier"
    out.write_bytes(earlier)
    seen = []

    def fail(stage: str, share: float) -> None:
        seen.append(share)
        if share > 0.5:
            raise fault

    with pytest.raises(fault if isinstance(fault, type) else type(fault)):
        rewrite_cloud([path], out, move, box(moved(points())), UTM, fail)
    assert seen == pytest.approx([0, 0.2, 0.4, 0.6])
    assert sorted(tmp_path.iterdir()) == [path, out]
    assert out.read_bytes() == earlier


def test_interruption_in_the_midst_of_compressing_is_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(self: Any, data: bytes) -> int:
        if self.tell() > 100_000:
            raise KeyboardInterrupt
        return int(self._stream.write(data))

    monkeypatch.setattr(las_file._Noting, "_put", interrupt)
    path = write_las(tmp_path / "a.laz", points(50_000))
    with pytest.raises(KeyboardInterrupt):
        rewrite_cloud([path], tmp_path / "o.laz", move, box(moved(points())), UTM)
    assert list(tmp_path.iterdir()) == [path]


def test_input_is_never_overwritten(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz", points(50))
    content = path.read_bytes()
    soft, hard = tmp_path / "soft.laz", tmp_path / "hard.laz"
    soft.symlink_to(path)
    os.link(path, hard)
    for out in (path, soft, hard, tmp_path / ".." / tmp_path.name / "a.laz"):
        with pytest.raises(OutputError, match="is the input itself"):
            rewrite_cloud([path], out, move, box(moved(points(50))), UTM)
    assert path.read_bytes() == content


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("out.ply", r"'.ply'; expected .laz or .las"),
        ("out", r"'none'; expected .laz"),
        ("out.copc.laz", r"'.copc.laz'; expected .laz"),
        ("folder.laz", "is not a file"),
        ("missing/out.laz", "its folder does not exist"),
    ],
)
def test_outputs_that_cannot_be_written_are_named(name: str, message: str, tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz", points(50))
    (tmp_path / "folder.laz").mkdir()
    with pytest.raises(OutputError, match=message) as caught:
        rewrite_cloud([path], tmp_path / name, move, box(moved(points(50))), UTM)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("ending", ["las", "laz"])
def test_full_disk_is_said(ending: str, tmp_path: Path) -> None:
    write_las(tmp_path / "a.laz", points(50_000))
    told = _run(
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))\n"
        "from quantify_client.errors import OutputError\n"
        f"try: rewrite_cloud([Path('a.laz')], Path('o.{ending}'), move, box, None)\n"
        "except OutputError as error: print(error)",
        tmp_path,
    )
    assert told.startswith(f"o.{ending}: cannot be written (")
    assert "File too large" in told
    assert told.count("\n") == 1
    assert list(tmp_path.iterdir()) == [tmp_path / "a.laz"]


def _run(code: str, folder: Path) -> str:
    """Run in a process of its own, with a move and a box. Returns what it printed."""
    head = (
        "import resource, sys; from pathlib import Path\n"
        "from quantify_client.cloud.writing import rewrite_cloud\n"
        "from quantify_client.types import Bounds\n"
        "move = lambda x, y, z: (x + 1, y, z)\n"
        "box = Bounds(0, 0, 0, 1e6, 6e6, 1e3)\n"
    )
    return subprocess.run(
        [sys.executable, "-c", head + code],
        cwd=folder,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        env={"PYTHONPATH": str(Path(rewrite.__file__).parents[3])},
    ).stdout


def test_place_beyond_what_integers_reach_is_an_error(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz", points(50))
    with pytest.raises(OutputError, match="[xy] = 5.*header's bounds"):
        rewrite_cloud([path], tmp_path / "o.laz", move, Bounds(0, 0, 0, 1, 1, 1e-3), None)

    def lose(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> Any:
        return x, y, z * np.nan

    with pytest.raises(OutputError, match="z = nan"):
        rewrite_cloud([path], tmp_path / "o.laz", lose, box(points(50)), None)
    with pytest.raises(OutputError, match="expected finite"):
        rewrite_cloud([path], tmp_path / "o.laz", move, Bounds(0, 0, 0, 1, 1, np.nan), None)
    assert list(tmp_path.iterdir()) == [path]


def test_memory_does_not_grow_with_the_points(tmp_path: Path) -> None:
    count = 3_000_000
    with laspy.open(
        tmp_path / "a.laz", "w", header=laspy.LasHeader(point_format=7, version="1.4")
    ) as writer:
        part = laspy.ScaleAwarePointRecord.zeros(count // 3, header=writer.header)
        part["X"] = np.arange(count // 3)
        for _ in range(3):
            writer.write_points(part)
    told = _run(
        "report = rewrite_cloud([Path('a.laz')], Path('b.laz'), move, box, 'EPSG:32615')\n"
        # VmHWM begins anew with the process; ru_maxrss would hold what it was forked from.
        "peak = [line for line in open('/proc/self/status') if line.startswith('VmHWM')]\n"
        "print(report.points, peak[0].split()[1])",
        tmp_path,
    )
    written, peak = map(int, told.split())
    assert written == count
    assert peak < 300 * 1024  # kB


@given(data=st.data())
def test_no_damage_of_the_input_passes_for_another_error(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("laz")
    path = write_las(folder / "a.laz", points(300), 6, "1.4", crs=UTM)
    content = bytearray(path.read_bytes())
    if data.draw(st.booleans()):
        content = content[: data.draw(st.integers(0, len(content) - 1))]
    else:
        place = data.draw(st.integers(0, len(content) - 1))
        content[place] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content)
    out, message = folder / "o.laz", ""
    try:
        report = rewrite_cloud([path], out, move, box(moved(points(300))), None)
    except (CloudError, OutputError) as error:
        message = str(error)
    if message:
        assert "\n" not in message
        assert list(folder.iterdir()) == [path]
    else:
        assert len(laspy.read(out)) == report.points
