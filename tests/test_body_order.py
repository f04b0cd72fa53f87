"""A body's numbers are the same bits in any order of its points, any chunks, threads and boxes."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any, Dict, Optional, Tuple

import numpy as np
import pytest
from clouds import write_las
from hypothesis import given, settings
from hypothesis import strategies as st
from scans import Flaws, scan
from solids import BODIES

from quantify_client import measure
from quantify_client.cloud.las.points import LasCloud

pytestmark = pytest.mark.one_python

METHODS = ["section", "polar"]
BOX_AT = 179  # of a LAS header: max x, min x, max y, min y, max z, min z


def ground_and_strays() -> np.ndarray:
    """A body on its ground with strays, in steps of a centimetre: many ties, some points twice."""
    flaws = Flaws(noise=0.003, outliers=0.01, ground=2.0)
    points = scan(BODIES["four legs"](), 800, seed=31, flaws=flaws)
    return np.round(np.concatenate([points, points[:100]]), 2)


def said(path: Path, method: str, threads: int = 1) -> Tuple[Any, ...]:
    """Return all numbers and words of a result, with every bit."""
    (r,) = measure(path, shape="object", method=method, threads=threads).results
    checks = [check.volume_m3 for check in r.checks]
    slices = [(part.z_m, part.area_m2, part.volume_m3, part.points) for part in r.slices]
    left_out = sorted(r.points_left_out.items())
    return r.volume_m3, r.std_m3, r.points_used, left_out, checks, slices, tuple(r.warnings)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("order")


@pytest.fixture(scope="module")
def whole(folder: Path) -> Dict[str, Tuple[Any, ...]]:
    path = write_las(folder / "body.las", ground_and_strays())
    return {method: said(path, method) for method in METHODS}


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=6, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.sampled_from([None, 61, 1000]),
    threads=st.integers(1, 3),
    wider=st.tuples(*[st.floats(-0.004, 0.02)] * 6),
)
def test_no_bit_depends_on_order_chunks_threads_or_the_header_s_box(
    folder: Path,
    whole: Dict[str, Tuple[Any, ...]],
    method: str,
    seed: int,
    size: Optional[int],
    threads: int,
    wider: Tuple[float, ...],
) -> None:
    points = ground_and_strays()
    path = write_las(
        folder / "body.las", points[np.random.default_rng(seed).permutation(len(points))]
    )
    _widen(path, wider)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(LasCloud, "chunks", _in_pieces(LasCloud.chunks, size))
        assert said(path, method, threads) == whole[method]


def _widen(path: Path, by: Tuple[float, ...]) -> None:
    data = bytearray(path.read_bytes())
    box = struct.unpack_from("<6d", data, BOX_AT)
    signs = (1, -1) * 3
    changed = [end + sign * more for end, sign, more in zip(box, signs, by)]
    struct.pack_into("<6d", data, BOX_AT, *changed)
    path.write_bytes(data)


def _in_pieces(chunks: Any, size: Optional[int]) -> Any:
    def cut(self: LasCloud, window: Any = None, *rest: Any, **named: Any) -> Any:
        for chunk in chunks(self, window, *rest, **named):
            step = size or max(len(chunk), 1)
            for start in range(0, len(chunk), step):
                part = slice(start, start + step)
                left_out = chunk.left_out if start == 0 else {}
                yield replace(
                    chunk, x=chunk.x[part], y=chunk.y[part], z=chunk.z[part], left_out=left_out
                )

    return cut
