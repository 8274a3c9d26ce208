"""Damage to files: characters, words, numbers, lines, elements, columns, arrays, bytes."""

import copy
import io
import re
import zipfile
from xml.etree import ElementTree

import numpy as np

NUMBERS = ("0", "-1", "3", "nan", "inf", "-inf", "1e308", "1e-320", "1e9", "-0.0")
NUMBERS += ("", "0x10", "1_0", "1,5", "٣", "9" * 400)
NAMES = (*"\0\ufeff\u202e<&\"'$\\{\n\t;#", "]]>", "%s", "../x", "é" * 300)
TYPES = ("f4", "i8", "u1", "c16", "U8", "S8", "?", "M8[s]", "f2", ">f8")
ENCODINGS = ("utf-8", "utf-16", "utf-32", "latin-1", "rot13", "hex", "x-none", "ascii", "", "idna")


def any_of(rng, choices):
    """One of the choices."""
    return choices[rng.integers(len(choices))]


def damaged(data, ending, rng):
    """A file's bytes with one error."""
    kinds = {".xml": _elements, ".urdf": _elements, ".csv": _columns, ".npz": _columns, ".mat": _bytes}
    kind = kinds.get(ending, _text)
    others = (_bytes,) if ending in (".npz", ".mat") else (_text, _encoding, _bytes)
    try:
        return any_of(rng, (*[kind] * 6, *others))(data, rng)
    except (ElementTree.ParseError, ValueError, LookupError, TypeError, OSError, zipfile.BadZipFile):
        # Damaged before, so that it cannot be read.
        return _bytes(data, rng)


def _text(data, rng):
    """A text with another word or number, or with a part more or less."""
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


def _encoding(data, rng):
    """The bytes in another encoding, declared or not, or with a byte order mark."""
    name, text = any_of(rng, ENCODINGS), data.decode("utf-8", "replace")
    if rng.integers(2):
        text = re.sub(r"^(<\?xml.*?\?>)?", f'<?xml version="1.0" encoding="{name}"?>', text)
    if rng.integers(2) and name in ("utf-16", "utf-32", "latin-1"):
        return text.encode(name, "replace")
    return any_of(rng, (b"", b"\xef\xbb\xbf", b"\xff\xfe")) + text.encode()


def _bytes(data, rng):
    """The bytes with some replaced, left out or put in, or without the rest."""
    at = int(rng.integers(len(data) or 1))
    length, new = any_of(rng, ((1, 1), (len(data), 0), (int(rng.integers(1, 200)), 0), (0, 20)))
    return data[:at] + bytes(rng.integers(256, size=new, dtype=np.uint8)) + data[at + length :]


def _elements(data, rng):
    """An XML file with an element left out, doubled, moved or with other attributes."""
    root = ElementTree.fromstring(data)
    parents = [(parent, child) for parent in root.iter() for child in parent]
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


def _columns(data, rng):
    """A table with a column less, of another name, type or shape, or with other numbers; or with fewer rows."""
    packed = data[:2] == b"PK"
    if packed:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            head, columns = [], list(archive.items())
    else:
        lines = data.decode("utf-8", "replace").splitlines()
        start = next((k for k, line in enumerate(lines) if not line.startswith("#")), 0)
        head, names = lines[:start], lines[start].split(",")
        columns = list(zip(names, np.array([line.split(",") for line in lines[start + 1 :]]).T, strict=True))
    (k, m), kind = rng.integers(len(columns), size=2), rng.integers(7)
    (name, x), other = columns[k], columns[m][0]
    if kind == 0:
        del columns[k]
    elif kind == 1:
        new = any_of(rng, [*(n for n in NAMES if n not in ("\0", "../x")), other, other.upper(), "t", "a/b"])
        columns[k] = new, x
    elif kind == 2:
        columns[k], columns[m] = (name, columns[m][1]), (other, x)
    elif kind == 3:
        start, end = sorted(rng.integers(len(x) + 1, size=2)) if x.ndim else (0, 0)
        columns = [(n, np.delete(y, np.s_[start:end], 0) if y.ndim and len(y) == len(x) else y) for n, y in columns]
    elif kind == 4 and packed:
        changed = [x[None], x.T, x.ravel(), np.zeros(()), *([x[..., :0], x[: len(x) // 2]] if x.ndim else [])]
        changed += [x.real.astype(any_of(rng, TYPES))] if x.dtype.kind in "fiu" else []
        columns[k] = name, any_of(rng, changed)
    else:
        columns[k] = name, _numbers(x, rng)
    if packed:
        out = io.BytesIO()
        np.savez(out, **dict(columns))
        return out.getvalue()
    rows = [",".join(row) for row in zip(*(np.asarray(y, str).tolist() for _, y in columns), strict=True)]
    return "\n".join([*head, ",".join(n for n, _ in columns), *rows, ""]).encode("utf-8", "replace")


def _numbers(x, rng):
    """Numbers of which one or all from one on are others, or all are scaled, noisy or later."""
    if rng.integers(8) == 0 and x.dtype.kind == "U":
        return np.full(x.shape, any_of(rng, NUMBERS))
    x = x.astype(float)
    at = int(rng.integers(len(x) + 1))
    number, factor = (float(any_of(rng, (0, np.nan, np.inf, -1e300, 5e-324, 1e5, 57.3, -1, 1e-3))) for _ in range(2))
    with np.errstate(over="ignore", invalid="ignore"):
        where = np.arange(len(x)).reshape(-1, *[1] * (x.ndim - 1))
        noisy = x + number * rng.normal(size=x.shape)
        return any_of(
            rng,
            (np.where(where == at, number, x), np.where(where > at, number, x), factor * x, noisy, np.roll(x, at, 0)),
        )
