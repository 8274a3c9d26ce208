"""Damage to files: characters, words, numbers, lines, elements, columns, arrays, bytes."""

import copy
import io
import json
import re
import zipfile
from collections.abc import Callable, Iterator, Sequence
from xml.etree import ElementTree

import numpy as np

Rng = np.random.Generator

NO_NUMBERS = ("", "0x10", "1_0", "1,5", "٣", "9" * 400)
NUMBERS = ("0", "-1", "3", "nan", "inf", "-inf", "1e308", "1e-320", "1e9", "-0.0", *NO_NUMBERS)
NAMES = (*"\0\ufeff\u202e<&\"'$\\{\n\t;#", "]]>", "%s", "../x", "é" * 300)
TYPES = ("f4", "i8", "u1", "c16", "U8", "S8", "?", "M8[s]", "f2", ">f8")
ENCODINGS = ("utf-8", "utf-16", "utf-32", "latin-1", "rot13", "hex", "x-none", "ascii", "", "idna")


def any_of(rng: Rng, choices: Sequence) -> object:
    """One of the choices."""
    return choices[rng.integers(len(choices))]


def damaged(data: bytes, ending: str, rng: Rng) -> bytes:
    """A file's bytes with one error."""
    kinds: dict[str, tuple[Callable[[bytes, Rng], bytes], ...]] = {
        ".xml": (_text, *[_elements] * 6, _encoding, _bytes),
        ".urdf": (_text, *[_elements] * 6, _encoding, _bytes),
        ".csv": (_text, *[_columns] * 6, _encoding, _bytes),
        ".toml": (*[_text] * 6, _encoding, _bytes),
        ".npz": (*[_arrays] * 4, _archive, _bytes),
        **dict.fromkeys((".mot", ".sto", ".trc"), (*[_text] * 6, _encoding, _bytes)),
        **dict.fromkeys((".mat", ".parquet", ".c3d", ".bag", ".mcap"), (_bytes,)),
        ".json": (*[_entry] * 6, _text, _encoding, _bytes),
    }
    return any_of(rng, kinds[ending])(data, rng)


def _text(data: bytes, rng: Rng) -> bytes:
    text = data.decode("utf-8", "replace")
    numbers, words = ([m.span() for m in re.finditer(p, text)] for p in (r"-?\d+(\.\d+)?(e-?\d+)?", r"[A-Za-z_]\w*"))
    (a, b), line = sorted(rng.integers(len(text) + 1, size=2)), text.find("\n", int(rng.integers(len(text) + 1)))
    number, word, other = (any_of(rng, spans) if spans else (a, a) for spans in (numbers, words, words))
    start, end, new = any_of(
        rng,
        [
            (*number, any_of(rng, NUMBERS)),
            (*word, any_of(rng, NAMES)),
            (*word, text[slice(*other)]),
            (a, a, any_of(rng, NAMES)),
            (a, min(b, a + 40), ""),
            (a, len(text), ""),
            (a, a, text[a : min(b, a + 400)]),
            (line, text.find("\n", line + 1), ""),
        ],
    )
    return (text[:start] + new + text[end:]).encode("utf-8", "replace")


def _encoding(data: bytes, rng: Rng) -> bytes:
    """The bytes in another encoding, declared or not, or with a byte order mark."""
    name, text = any_of(rng, ENCODINGS), data.decode("utf-8", "replace")
    if rng.integers(2):
        text = re.sub(r"^(<\?xml.*?\?>)?", f'<?xml version="1.0" encoding="{name}"?>', text)
    if rng.integers(2) and name in ("utf-16", "utf-32", "latin-1"):
        return text.encode(name, "replace")
    return any_of(rng, (b"", b"\xef\xbb\xbf", b"\xff\xfe")) + text.encode()


def _bytes(data: bytes, rng: Rng) -> bytes:
    data, at = bytearray(data), int(rng.integers(len(data) or 1))
    kind = rng.integers(4)
    if kind == 0:
        data[at : at + 1] = bytes(rng.integers(256, size=1, dtype=np.uint8))
    elif kind == 1:
        del data[at:]
    elif kind == 2:
        del data[at : at + int(rng.integers(1, 200))]
    else:
        data[at:at] = bytes(rng.integers(256, size=20, dtype=np.uint8))
    return bytes(data)


def _elements(data: bytes, rng: Rng) -> bytes:
    """An XML file with an element left out, doubled, moved or with other attributes."""
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError):
        return _bytes(data, rng)
    parents = [(parent, child) for parent in root.iter() for child in parent]
    if not parents:
        return _bytes(data, rng)
    (parent, child), (other, sibling) = (any_of(rng, parents) for _ in range(2))
    kind = rng.integers(6)
    if kind == 0:
        parent.remove(child)
    elif kind == 1:
        parent.append(copy.deepcopy(child))
    elif kind == 2:
        other.append(copy.deepcopy(child))
    elif kind == 3 and child.attrib:
        del child.attrib[any_of(rng, list(child.attrib))]
    elif child.attrib:
        values = [*NUMBERS, *(n for n in NAMES if n != "\0"), *sibling.attrib.values(), "0 0 0", "1 2 3 4", "0 0"]
        child.set(any_of(rng, [*child.attrib, *sibling.attrib]), any_of(rng, values))
    return ElementTree.tostring(root, encoding="utf-8")


def _columns(data: bytes, rng: Rng) -> bytes:
    """A CSV file with a column of another name, other numbers, or in another place."""
    lines = data.decode("utf-8", "replace").splitlines()
    first = next((k for k, line in enumerate(lines) if not line.startswith("#")), 0)
    rows = [line.split(",") for line in lines[first:]]
    if len(rows) < 2:
        return _bytes(data, rng)
    k, m = (int(i) for i in rng.integers(len(rows[0]), size=2))
    change = _damaged_numbers(rng)
    cells = [row[k] if k < len(row) else "" for row in rows[1:]]
    kind = rng.integers(6)
    if kind == 0:
        rows[0][k] = str(any_of(rng, [*NAMES, *rows[0], "t", "q_joint1", rows[0][m].upper()]))
    elif kind == 1:
        rows = [row[:k] + row[k + 1 :] for row in rows]
    elif kind == 2:
        rows[0][k], rows[0][m] = rows[0][m], rows[0][k]
    elif kind == 3:
        start, end = sorted(rng.integers(1, len(rows), size=2))
        rows[start:end] = []
    else:
        try:
            new = [repr(float(x)) for x in change(np.array(cells, float))]
        except ValueError:
            new = [str(any_of(rng, NUMBERS))] * len(cells)
        rows[1:] = [[*row[:k], x, *row[k + 1 :]] for row, x in zip(rows[1:], new, strict=True)]
    return "\n".join([*lines[:first], *map(",".join, rows), ""]).encode("utf-8", "replace")


def _entry(data: bytes, rng: Rng) -> bytes:
    """A JSON file with an entry left out, or with another value, perhaps that of another entry."""
    try:
        content = json.loads(data)
        data.decode("utf-8")
    except (ValueError, RecursionError):
        return _bytes(data, rng)
    ways = list(_ways(content))
    if not ways:
        return data
    (place, key), (other, its) = (any_of(rng, ways) for _ in range(2))
    if rng.integers(4) == 0:
        del place[key]
    else:
        numbers = (None, True, -1, 0, 1e300, float("nan"), 10**400, "", "$x_", "\ud800", [], {}, [[]])
        place[key] = any_of(rng, [*numbers, copy.deepcopy(other[its])])
    return json.dumps(content).encode()


def _ways(content: object) -> Iterator[tuple[object, object]]:
    """Containers and keys of all entries of a JSON value."""
    pairs = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in list(pairs):
        yield content, key
        yield from _ways(value)


def _damaged_numbers(rng: Rng) -> Callable[[np.ndarray], np.ndarray]:
    """A function that damages numbers (N,)."""
    at, factor = rng.random(), float(any_of(rng, (0, -1, 1e-3, 57.3, 1e6, 1e300, np.nan, np.inf)))
    number = float(any_of(rng, (0, np.nan, np.inf, -1e300, 5e-324, 1e5)))

    def one(x: np.ndarray) -> np.ndarray:
        return np.where(np.arange(len(x)) == int(at * len(x)), number, x)

    def run(x: np.ndarray) -> np.ndarray:
        return np.where(np.arange(len(x)) > at * len(x), number, x)

    def scaled(x: np.ndarray) -> np.ndarray:
        with np.errstate(over="ignore", invalid="ignore"):
            return x * factor

    def noisy(x: np.ndarray) -> np.ndarray:
        return x + at * np.random.default_rng(int(1e9 * at)).normal(size=len(x))

    def turned(x: np.ndarray) -> np.ndarray:
        return np.roll(x, int(at * len(x)))

    return any_of(rng, (one, run, scaled, noisy, turned))


def _arrays(data: bytes, rng: Rng) -> bytes:
    """An npz file with an array of another name, type, shape or other numbers."""
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = dict(archive)
    except Exception:
        return _bytes(data, rng)
    if not arrays:
        return data
    name, other = (any_of(rng, list(arrays)) for _ in range(2))
    x, kind = arrays[name], rng.integers(8)
    if kind == 0:
        del arrays[name]
    elif kind == 1:
        arrays[str(any_of(rng, [*(n for n in NAMES if n not in "\0../x"), other, "a/b"]))] = arrays.pop(name)
    elif kind == 2 and x.dtype.kind in "fiu":
        with np.errstate(all="ignore"):
            arrays[name] = x.real.astype(any_of(rng, TYPES))
    elif kind == 3:
        arrays[name] = any_of(
            rng, [x[None], x.T, x[..., :0] if x.ndim else x, np.zeros(()), x[: len(x) // 2] if x.ndim else x, x.ravel()]
        )
    elif kind == 4:
        arrays["extra"] = any_of(rng, [x, np.array(["a"]), np.zeros((3, 0)), np.zeros(())])
    elif x.dtype.kind == "f" and x.ndim:
        flat = x.reshape(len(x), -1).copy()
        k = int(rng.integers(flat.shape[1])) if flat.shape[1] else 0
        if flat.size:
            flat[:, k] = _damaged_numbers(rng)(flat[:, k])
        arrays[name] = flat.reshape(x.shape)
    else:
        arrays[name] = arrays[other]
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def _archive(data: bytes, rng: Rng) -> bytes:
    """An archive with another compression, and one damaged member."""
    out = io.BytesIO()
    method = any_of(rng, (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA))
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w", method) as new:
            hit = int(rng.integers(2 * len(old.namelist()) + 1))
            for k, name in enumerate(old.namelist()):
                new.writestr(name, _bytes(old.read(name), rng) if k == hit else old.read(name))
    except Exception:
        return _bytes(data, rng)
    return _bytes(out.getvalue(), rng) if rng.integers(2) else out.getvalue()
