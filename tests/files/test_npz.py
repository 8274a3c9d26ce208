"""Malicious archives: every reader gives one sentence and takes little memory."""

import io
import json
import struct
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
from commands import refusal

import scenes
from experiments import identify
from experiments.runs.workers import Checkpoint
from ident.errors import InputError
from ident.estimate import Estimate
from ident.mechanism.body import Body
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.recordings.log import read_log
from ident.recordings.recording import Recording

PENDULUM = Path(scenes.__file__).parent / "double_pendulum.xml"


def npy(array):
    stream = io.BytesIO()
    np.lib.format.write_array(stream, array)
    return stream.getvalue()


X = npy(np.arange(40.0))


def with_header(text):
    """An array of 40 numbers with this text as its header."""
    header = text.encode() + b" " * (-len(text) % 64) + b"\n"
    return b"\x93NUMPY\x02\x00" + struct.pack("<I", len(header)) + header + X[-320:]


HEADER = "{'descr': '<f8', 'fortran_order': False, 'shape': %s, }"
EVIL = {
    "open bracket": (with_header(HEADER % "(40,("), zipfile.ZIP_STORED),
    "deep": (with_header(HEADER % ("(" * 3000)), zipfile.ZIP_STORED),
    "absurd": (with_header(HEADER % "(10000000000000000,)"), zipfile.ZIP_STORED),
    "overflow": (with_header(HEADER % "(4611686018427387904, 16)"), zipfile.ZIP_STORED),
    "endless and empty": (with_header(HEADER % "(0, 400000000)"), zipfile.ZIP_STORED),
    "negative": (with_header(HEADER % "(-40,)"), zipfile.ZIP_STORED),
    "no type": (with_header(HEADER.replace("<f8", "<q9") % "(40,)"), zipfile.ZIP_STORED),
    "long": (with_header(HEADER % "(40,)" + " " * 20_000), zipfile.ZIP_STORED),
    "lzma": (X, zipfile.ZIP_LZMA),
    "bzip2": (X, zipfile.ZIP_BZIP2),
    "pickle": (npy(np.array([{}] * 40, object)), zipfile.ZIP_STORED),
    "no array": (b"text", zipfile.ZIP_DEFLATED),
    "empty": (b"", zipfile.ZIP_STORED),
}


def archive(path, content, compression=zipfile.ZIP_STORED):
    """A file that can be read as log, recording and both kinds of saved results."""
    members = {"time": npy(np.arange(40) / 100), "metadata": npy(np.array("{}")), "identity": npy(np.array("{}"))}
    with zipfile.ZipFile(path, "w") as out:
        for name, data in (members | {"done": npy(np.array(1))}).items():
            out.writestr(f"{name}.npy", data)
        for name in ("measured/elbow_position", "outcomes", "objects"):
            out.writestr(f"{name}.npy", content, compression)
    return path


ELBOW = Body("arm", -1, np.eye(4), np.array([0, 0, 0, 0, 1, 0]), "elbow")
READERS = {
    "log": lambda path: read_log(path, Mechanism(Tree((ELBOW,)), np.zeros(3))),
    "recording": Recording.load,
    "pieces": lambda path: next(Recording.chunks(path, 7)),
    "outcomes": lambda path: Checkpoint("runs", path, {}).done(),
    "estimate": Estimate.load,
}


@pytest.mark.parametrize("read", READERS.values(), ids=READERS)
def test_whatever_is_wrong_with_a_member_is_one_sentence(tmp_path, read):
    for what, (content, compression) in EVIL.items():
        path = archive(tmp_path / "evil.npz", content, compression)
        with pytest.raises(InputError, match=r"evil\.npz") as raised:
            read(path)
        assert "\n" not in str(raised.value) and len(str(raised.value)) < 500, what


def unpacking(path, size, stated):
    """An archive with a channel that unpacks to so many bytes, and a directory that states another number."""
    archive(path, npy(np.zeros(size // 8 - 16)), zipfile.ZIP_DEFLATED)
    path.write_bytes(path.read_bytes().replace(struct.pack("<I", size), struct.pack("<I", stated)))
    return path


@pytest.mark.parametrize("stated", [100, 1000, 700_000_000])
def test_a_small_file_is_not_unpacked_to_a_large_one(tmp_path, stated):
    path = unpacking(tmp_path / "bomb.npz", 16_000_000, stated)
    for name, read in READERS.items():
        tracemalloc.start()
        try:
            with pytest.raises(InputError, match=r"bomb\.npz"):
                read(path)
            assert tracemalloc.get_traced_memory()[1] < 2_000_000, name
        finally:
            tracemalloc.stop()


def test_the_limit_is_raised_by_an_option(tmp_path, capsys):
    channels = {"time": np.arange(2000) / 100, "measured/wide": np.zeros((2000, 600))}
    np.savez_compressed(tmp_path / "wide.npz", metadata=json.dumps({}), **channels)
    given = [str(PENDULUM), str(tmp_path / "wide.npz"), "--out", str(tmp_path / "out")]
    sentence = (
        "takes 10 MB in memory where at most 9 MB are expected of it; if it may be so large, say so (--max-size)."
    )
    assert sentence in refusal(identify.main, [*given, "--max-size", "9"], capsys)
    assert sentence[:20] not in refusal(identify.main, given, capsys)
