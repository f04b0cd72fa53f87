"""Ways to damage a file: any bytes, lines of text, nodes of JSON, fields of headers, zip members.

Each takes the file's bytes and a random generator and returns other bytes. Which ones a file can
meet is told by its ending.
"""

from __future__ import annotations

import io
import json
import re
import struct
import zipfile
from random import Random
from typing import Any, Callable, Dict, List, Sequence, Tuple

Damage = Callable[[bytes, Random], bytes]

_INTEGERS = (
    0,
    1,
    -1,
    2,
    255,
    2**15,
    2**16 - 1,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**62,
    2**63,
    2**64 - 1,
)
_DOUBLES = (0.0, -0.0, 1.0, -1.0, 5e-324, 1e18, -1e18, 1e300, -1e300, *map(float, ("nan", "inf")))
_WORDS = (
    *("0", "-1", "1e18", "-1e18", "1e300", "1e-320", "1e999", "nan", "inf", "9" * 25, "1" * 5000),
    *("", '"', "'", "x", "true", "null", "~", "[", "{", "&a", "*a", "!!python/name:os.system"),
    *("\u00fc", "\u202e", "\x00", "\x1b[31m", "\ufeff", "EPSG:99999", "EPSG:4979", "EPSG:4978"),
    *(
        "+proj=utm +zone=15 +ellps=WGS84",
        "+proj=longlat +lon_0=nan",
        "../../etc/passwd",
        "A" * 70_000,
    ),
)


def damage(name: str, data: bytes, random: Random, others: Sequence[bytes]) -> bytes:
    """Damage a file once to four times, by what its name says it is."""
    ways = [*_BYTES, *_BY_ENDING.get(_ending(name), ())]
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        if random.random() < 0.05:
            data = _spliced(data, random, random.choice(others))
        # What knows the format goes deeper: half of all tries.
        known = _BY_ENDING.get(_ending(name), ())
        way = random.choice(known) if known and random.random() < 0.6 else random.choice(ways)
        data = way(data, random)
    return data


def _ending(name: str) -> str:
    return name.rsplit(".", 1)[-1].lower()


# --- any bytes


def _flipped(data: bytes, random: Random) -> bytes:
    out = bytearray(data)
    for _ in range(random.choice((1, 1, 2, 8, 64)) if out else 0):
        out[_place(out, random)] ^= 1 << random.randrange(8)
    return bytes(out)


def _place(data: Sequence[int], random: Random) -> int:
    """A position, in the first kilobyte as often as in all the rest: headers are there."""
    return random.randrange(min(len(data), random.choice((64, 1024, len(data)))) or 1)


def _cut(data: bytes, random: Random) -> bytes:
    return data[: random.choice((_place(data, random), random.randrange(len(data) + 1)))]


def _dropped(data: bytes, random: Random) -> bytes:
    start = _place(data, random)
    return data[:start] + data[start + random.choice((1, 4, 100, 5000)) :]


def _repeated(data: bytes, random: Random) -> bytes:
    start, length = _place(data, random), random.choice((1, 20, 300, 5000))
    return data[:start] + data[start : start + length] * random.choice((2, 3, 50)) + data[start:]


def _blanked(data: bytes, random: Random) -> bytes:
    start, length = _place(data, random), random.choice((4, 32, 500))
    filling = random.choice((b"\0", b"\xff", b" ", b"["))
    return data[:start] + (filling * length)[: len(data) - start] + data[start + length :]


def _swapped(data: bytes, random: Random) -> bytes:
    a, b = sorted((_place(data, random), random.randrange(len(data) + 1)))
    return data[b:] + data[a:b] + data[:a]


def _numbered(data: bytes, random: Random) -> bytes:
    """Overwrite what may be a number in a binary header."""
    kind = random.choice(("<H", "<I", "<q", ">I", "<d", ">d", "<f"))
    return _put(data, _place(data, random), kind, random)


def _put(data: bytes, at: int, kind: str, random: Random) -> bytes:
    size = struct.calcsize(kind)
    if kind[-1] == "d":
        raw = struct.pack(kind, random.choice(_DOUBLES))
    elif kind[-1] == "f":
        raw = struct.pack(kind, random.choice((0.0, -1.0, 1e38, float("nan"), float("inf"))))
    else:
        value = random.choice(_INTEGERS) & (256**size - 1)
        raw = value.to_bytes(size, "big" if kind[0] == ">" else "little")
    return data[:at] + raw + data[at + size :] if at + size <= len(data) else data


def _spliced(data: bytes, random: Random, other: bytes) -> bytes:
    return data[: random.randrange(len(data) + 1)] + other[random.randrange(len(other) + 1) :]


_BYTES: Tuple[Damage, ...] = (
    *(_flipped, _flipped, _cut, _dropped, _repeated, _blanked, _swapped, _numbered, _numbered),
)


# --- text

_NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
_WORD = re.compile(r"[^\s,;:\[\]{}\"=<>()]+")


def _with_word(data: bytes, random: Random, pattern: Any = _WORD) -> bytes:
    text = data.decode("utf-8", "surrogateescape")
    found = list(pattern.finditer(text[:200_000]))
    if not found:
        return data
    early = found[: random.choice((10, 100, len(found)))]
    match = random.choice(early)
    text = text[: match.start()] + random.choice(_WORDS) + text[match.end() :]
    return text.encode("utf-8", "surrogateescape")


def _with_number(data: bytes, random: Random) -> bytes:
    return _with_word(data, random, _NUMBER)


def _lines(data: bytes, random: Random) -> bytes:
    """Drop, repeat, join, swap or lengthen lines."""
    lines = data.split(b"\n")
    at = random.randrange(min(len(lines), random.choice((3, 30, len(lines)))))
    way = random.randrange(6)
    if way == 0:
        del lines[at]
    elif way == 1:
        lines[at:at] = [lines[at]] * random.choice((1, 10, 10_000))
    elif way == 2:
        lines[at] += random.choice((b",", b" ", b"\t", b";", b'"', b"#", b"\r")) * random.choice(
            (1, 100)
        )
    elif way == 3:
        random.shuffle(lines)
    elif way == 4:
        lines[at] = lines[at] * 3000
    else:
        return b" ".join(lines)
    return b"\n".join(lines)


def _recoded(data: bytes, random: Random) -> bytes:
    text = data.decode("utf-8", "replace")
    return text.encode(random.choice(("utf-16", "utf-8-sig", "utf-32", "utf-16-be")), "replace")


_TEXT: Tuple[Damage, ...] = (_with_word, _with_number, _with_number, _lines, _recoded)


# --- JSON


def _values() -> List[Any]:
    return [
        *(None, True, False, 0, -1, 10**18, 10**400, 1e300, 1e18, float("nan"), float("inf")),
        *("", "x", "nan", "1e999", "a\nb", "\u202e\ud800", "../x", "/dev/zero", "x" * 70_000),
        *([], {}, [[]], [None], [1e300, -1e300, 5], {"": None}, [0] * 3000, [[[[[[[[[[[]]]]]]]]]]]),
    ]


def _tree(data: bytes, random: Random) -> bytes:
    """Change one node of a document, or nest it deeply."""
    try:
        tree = json.loads(data)
    except (ValueError, RecursionError):
        return _with_word(data, random)
    places: List[Tuple[Any, Any]] = []
    waiting = [tree]
    while waiting and len(places) < 5000:
        node = waiting.pop()
        keys = (
            node if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ()
        )
        places += [(node, key) for key in keys]
        waiting += [node[key] for key in keys]
    if not places or random.random() < 0.05:
        return b"[" * random.choice((50, 900, 200_000)) + data
    node, key = random.choice(places)
    _change(node, key, random, places)
    return json.dumps(tree).encode("utf-8", "surrogatepass")


def _change(node: Any, key: Any, random: Random, places: Sequence[Tuple[Any, Any]]) -> None:
    way = random.randrange(8)
    if way == 0:
        del node[key]
    elif way == 1:
        node[key] = [node[key]] * random.choice((1, 2, 1000))
    elif way == 2:
        other, place = random.choice(places)
        if place in (other if isinstance(other, dict) else range(len(other))):
            node[key] = json.loads(json.dumps(other[place]))
    elif way == 3 and isinstance(node, dict):
        node[random.choice(("x", "", "crs", "type", "extra", "9-9-9-9"))] = node.pop(key)
    elif way == 4 and isinstance(node[key], (int, float)) and not isinstance(node[key], bool):
        node[key] = random.choice((-node[key], node[key] * 1e12, str(node[key]), node[key] + 0.5))
    else:
        node[key] = random.choice(_values())


# --- headers of LAS

_LAS_FIELDS: Sequence[Tuple[int, str]] = (
    *((6, "<H"), (24, "B"), (25, "B"), (90, "<H"), (94, "<H"), (96, "<I"), (100, "<I"), (104, "B")),
    *((105, "<H"), (107, "<I"), *((111 + 4 * i, "<I") for i in range(5))),
    *((131 + 8 * i, "<d") for i in range(12)),
    *((227, "<Q"), (235, "<Q"), (243, "<I"), (247, "<Q"), (255, "<Q")),
)


def _las_field(data: bytes, random: Random) -> bytes:
    """Change a field of the header, of a record behind it, or of the compressor's table."""
    places = list(_LAS_FIELDS)
    if len(data) > 375:
        size, first = struct.unpack_from("<HI", data, 94)
        record = size
        while record + 54 <= min(first, len(data)) and len(places) < 200:
            length = struct.unpack_from("<H", data, record + 20)[0]
            places += [(record + 18, "<H"), (record + 20, "<H")]
            inside = range(0, length, random.choice((2, 4, 8)))
            places += [(record + 54 + i, random.choice(("<H", "<I", "<d"))) for i in inside][:60]
            record += 54 + length
        for spot in (first, len(data) - 8):
            places += [(spot, "<q"), (spot, "<I")]
        if first + 8 <= len(data):
            table = struct.unpack_from("<q", data, first)[0]
            places += [(table, "<I"), (table + 4, "<I"), (table + 8, "<I")] if table > 0 else []
        extended = struct.unpack_from("<Q", data, 235)[0]
        places += [(extended + 20, "<Q"), (extended + 60, "<Q"), (extended + 76, "<I")]
    at, kind = random.choice(places)
    return _put(data, at, kind if kind != "B" else "<B", random) if at < len(data) else data


# --- zips


def _members(data: bytes, random: Random) -> bytes:
    """Damage a member by its own ending, or the way it is packed."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = [(info.filename, archive.read(info)) for info in archive.infolist()]
    except Exception:  # it was damaged before
        return _flipped(data, random)
    if not members:
        return data
    at = random.randrange(len(members))
    name, content = members[at]
    way = random.randrange(8)
    if way == 0:
        del members[at]
    elif way == 1:
        members[at] = (random.choice(_NAMES), content)
    elif way == 2:
        members += [(f"{name}{n}", b"") for n in range(random.choice((1, 20_000)))]
    elif way == 3:
        members[at] = (name, content + b"\0" * random.choice((1, 30_000_000)))
    elif way == 4:
        members.append((name, content))
    else:
        members[at] = (name, damage(name, content, random, [content]))
    out = io.BytesIO()
    kind = random.choice(
        (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    )
    with zipfile.ZipFile(out, "w", kind) as archive:
        for name, content in members:
            info = zipfile.ZipInfo(name or "x")
            info.compress_type = kind
            if random.random() < 0.02:
                info.external_attr = 0o120777 << 16  # a link
            archive.writestr(info, content)
    return out.getvalue()


_NAMES = (
    *(
        "../../x.laz",
        "/x.laz",
        "C:\\x.laz",
        "x",
        "a/" * 400 + "x.laz",
        "\u202e.laz",
        "n" * 300 + ".laz",
    ),
    *(
        "odm_georeferencing/odm_georeferenced_model.ply",
        "odm_georeferencing/",
        "ept.json",
        "CON.las",
    ),
)
_DIRECTORY = ((b"PK\x05\x06", 22), (b"PK\x01\x02", 46), (b"PK\x03\x04", 30), (b"PK\x06\x06", 56))


def _zip_field(data: bytes, random: Random) -> bytes:
    """Change a field of a header or of the directory at the end."""
    mark, size = random.choice(_DIRECTORY)
    places = [match.start() for match in re.finditer(re.escape(mark), data)]
    if not places:
        return data
    at = random.choice(places) + 4 + 2 * random.randrange((size - 4) // 2)
    return _put(data, at, random.choice(("<H", "<I")), random)


_JSON: Tuple[Damage, ...] = (*_TEXT, _tree, _tree, _tree, _tree, _tree)
_LAS: Tuple[Damage, ...] = (_las_field,)
_BY_ENDING: Dict[str, Tuple[Damage, ...]] = {
    **dict.fromkeys(("json", "geojson", "jsonl", "yaml"), _JSON),
    **dict.fromkeys(("csv", "xyz", "txt", "kml", "dxf", "prj", "ply"), _TEXT),
    **dict.fromkeys(("las", "laz"), _LAS),
    "zip": (_members, _members, _members, _zip_field),
}
