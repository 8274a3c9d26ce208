"""Downloads from a server on this machine, and converters of published files, each on a small file of its format."""

import hashlib
import io
import pickle
import re
import sqlite3
import struct
import zipfile
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import mujoco
import numpy as np
import pytest
from commands import sentence_of

from experiments.data.validation import Entry, Source, SourceFile
from experiments.studies.validation.converters import clamped, joint_states, noisy, tensors, wrong_bodies
from experiments.studies.validation.files import Places, address, cache, checked, convert, download, fetched
from ident.errors import InputError

CONTENT = bytes(range(256)) * 3000
SHA256 = hashlib.sha256(CONTENT).hexdigest()


@contextmanager
def server(content=CONTENT, *, status=200, whole=None, location=None):
    """Address of a server that may lie about the size, redirect, and the files that it is asked for."""
    asked = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path.rpartition("/")[2])
            self.send_response(status)
            self.send_header("Content-Length", str(whole or len(content)))
            if location is not None:
                self.send_header("Location", location)
            self.end_headers()
            with suppress(ConnectionError):
                self.wfile.write(content)

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as httpd, ThreadPoolExecutor() as executor:
        executor.submit(httpd.serve_forever, poll_interval=0.01)
        try:
            yield f"http://127.0.0.1:{httpd.server_port}", asked
        finally:
            httpd.shutdown()


def test_a_file_is_downloaded_and_its_hash_returned(tmp_path):
    with server() as (url, asked):
        assert download(f"{url}/a.csv", tmp_path / "new" / "a.csv", SHA256) == SHA256
    assert (tmp_path / "new" / "a.csv").read_bytes() == CONTENT and asked == ["a.csv"]
    with pytest.raises(InputError, match=r"is there a network\?.*--data"):
        download(f"{url}/a.csv", tmp_path / "a.csv", SHA256)
    assert [path.name for path in tmp_path.rglob("*")] == ["new", "a.csv"]


@pytest.mark.parametrize(
    ("content", "options", "message"),
    [
        (CONTENT + b"!", {}, f"the registry expects {SHA256}"),
        (CONTENT[:1000], {"whole": len(CONTENT)}, "after 1000 of 768000"),
        *(
            (CONTENT, {"status": 302, "location": location}, "cannot be downloaded")
            for location in ("http://[::1", "https://exam ple.org/a", "https://example.org:port/", "data:,x")
        ),
    ],
)
def test_what_is_wrong_leaves_nothing_but_the_earlier_file(tmp_path, content, options, message):
    (tmp_path / "a.csv").write_bytes(b"earlier")
    with server(content, **options) as (url, _), pytest.raises(InputError, match=message):
        download(f"{url}/a.csv", tmp_path / "a.csv", SHA256)
    assert (tmp_path / "a.csv").read_bytes() == b"earlier" and len(list(tmp_path.iterdir())) == 1


ENTRY = Entry(
    *("arm", "Arm", "An arm.", "arm", True),
    Source("somebody/arms", "0123abc", "MIT"),
    (SourceFile("a.csv", "data/a b.csv", SHA256),),
)


def test_what_may_not_be_copied_or_is_of_unknown_origin_is_not_downloaded():
    for licence in ("", "proprietary"):
        closed = replace(ENTRY, source=replace(ENTRY.source, licence=licence))
        assert "lets nobody copy it" in sentence_of(address, closed, ENTRY.files[0])
    assert "where 'b.csv' is published is not known" in sentence_of(address, ENTRY, SourceFile("b.csv"))


def test_files_are_fetched_once(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache() == tmp_path / "multicontact" / "recordings"
    with server() as (url, asked):
        places = Places(tmp_path / "absent", fetch=True, host=url)
        folder = places.folder(ENTRY)
        assert places.folder(ENTRY) == fetched(ENTRY, folder, url) == folder == cache() / "arm"
    assert asked == ["a%20b.csv"] and checked(ENTRY, folder) == ()
    (folder / "a.csv").write_bytes(CONTENT[:-1])
    assert "another file than the one that was tried" in sentence_of(checked, ENTRY, folder)
    other = replace(ENTRY, folder="other")
    assert "has no a.csv; --fetch" in sentence_of(Places(tmp_path / "absent").folder, other)
    assert "--fetch downloads them, or --data FOLDER" in sentence_of(Places().folder, other)


def test_a_published_file_is_converted_after_its_download(tmp_path):
    model = b'<robot name="r">\n<link name="base"/>\n</robot>\n'
    file = SourceFile("r.urdf", "r.urdf", "1" * 64, hashlib.sha256(model).hexdigest(), made="declared_world")
    entry = replace(ENTRY, files=(file,))
    with server(model) as (url, _):
        fetched(entry, tmp_path, url)
    assert '<link name="world"/>' in (tmp_path / "r.urdf").read_text(encoding="utf-8")
    assert [path.name for path in tmp_path.iterdir()] == ["r.urdf"]
    # It may be written otherwise than the one that was tried.
    assert checked(entry, tmp_path) == ("r.urdf",)


MJCF = """<mujoco><asset><mesh name="shell" file="shell.obj"/></asset><worldbody>
<body name="trunk"><freejoint name="root"/><geom type="mesh" mesh="shell"/>
<inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>
<body name="leg"><joint name="hip" axis="0 1 0"/><geom type="sphere" size="0.1"/></body></body></worldbody>
<keyframe><key name="home" qpos="0 0 0 1 0 0 0 0"/></keyframe></mujoco>"""


def test_published_files_are_made_noisy_wrong_or_clamped(tmp_path):
    """By columns, and the same again; bodies stay physical."""
    exact, out = tmp_path / "in.sto", [tmp_path / "out.sto", tmp_path / "again.sto"]
    names = ["time", "pelvis_tx", "knee_angle_r", "ground_force_r_px", "ground_force_r_vy"]
    exact.write_text("\n".join(["inDegrees=no", "endheader", "\t".join(names), *["1\t1\t1\t1\t1"] * 400]))
    for each in out:
        noisy(exact, each)
    text = out[0].read_text(encoding="utf-8")
    assert text == out[1].read_text(encoding="utf-8") and text.startswith("inDegrees=no\nendheader\n")
    table = np.loadtxt(out[0], skiprows=3)
    np.testing.assert_allclose(table.std(axis=0), [0, 1e-3, np.radians(0.5), 0, 1.0], rtol=0.1)

    text = "<mass>2</mass><mass_center>0 1 3</mass_center><inertia>1 1 1 0 0 0</inertia><mesh>2</mesh>"
    (tmp_path / "in.osim").write_text(text, encoding="utf-8")
    wrong_bodies(tmp_path / "in.osim", tmp_path / "out.osim")
    made = (tmp_path / "out.osim").read_text(encoding="utf-8")
    mass, *rest = (float(x) for x in re.findall(r"[\d.]+", made))
    assert made.endswith("<mesh>2</mesh>") and 0 < abs(mass / 2 - 1) <= 0.2
    assert rest[2] == pytest.approx(3 * rest[1]) and rest[3] == rest[4] == rest[5] != 1

    (tmp_path / "in.xml").write_text(MJCF, encoding="utf-8")
    clamped(tmp_path / "in.xml", tmp_path / "out.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    assert (model.njnt, model.nmesh, model.nkey, model.ngeom) == (1, 0, 0, 1)


def cdr(seconds, joints, *numbers):
    out = bytearray(struct.pack("<iI", int(seconds), round(1e9 * (seconds % 1))))

    def put(form, value):
        out.extend(bytes(-len(out) % struct.calcsize(form)) + struct.pack("<" + form, value))

    for name in ("frame", None, *joints):
        put("I", len(joints) if name is None else len(name) + 1)
        out.extend(b"" if name is None else name.encode() + b"\0")
    for each in numbers:
        put("I", len(each))
        for x in each:
            put("d", x)
    return b"\0\1\0\0" + bytes(out)


def bag(path, messages):
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("CREATE TABLE topics (id INTEGER, name TEXT, type TEXT)")
        connection.execute("CREATE TABLE messages (topic_id INTEGER, timestamp INTEGER, data BLOB)")
        topics = [(1, "/states", "sensor_msgs/msg/JointState"), (2, "/tf", "tf2_msgs/msg/TFMessage")]
        connection.executemany("INSERT INTO topics VALUES (?, ?, ?)", topics)
        connection.executemany("INSERT INTO messages VALUES (?, ?, ?)", messages)


def test_a_bag_s_joint_states_become_a_table(tmp_path):
    rows = [(2.5, [0.1, 0.2], [1.0, 2.0], [10.0, 20.0]), (2.75, [0.3, 0.4], [3.0, 4.0], [30.0, 40.0])]
    messages = [(1, k, cdr(t, ["shoulder", "el"], *more)) for k, (t, *more) in reversed(list(enumerate(rows)))]
    bag(tmp_path / "in.db3", [*messages, (2, 5, b"something else")])
    joint_states(tmp_path / "in.db3", tmp_path / "out.csv")
    head, *lines = (tmp_path / "out.csv").read_text(encoding="utf-8").splitlines()
    assert head.split(",")[:3] == ["time", "shoulder_position", "el_position"] and head.endswith(",el_torque")
    expected = [[t - 2.5, *q, *dq, *tau] for t, q, dq, tau in rows]
    assert [[float(x) for x in line.split(",")] for line in lines] == expected


def test_what_cannot_be_converted_is_a_sentence(tmp_path):
    """A tensor file runs no code."""
    bag(tmp_path / "in.db3", [])
    bag(tmp_path / "short.db3", [(1, 0, cdr(0, ["a"], [1.0], [1.0], [1.0])[:-4])])
    (tmp_path / "none.db3").write_bytes(b"no bag at all" * 100)
    tensor_file(tmp_path / "code.pt", {"time": np.zeros(1, "<f4")}, rebuild=("os", "system"))
    (tmp_path / "none.pt").write_bytes(pickle.dumps({}))
    for converter, name, message in (
        ("joint_states", "in.db3", "holds no joint states"),
        ("joint_states", "short.db3", "is damaged"),
        ("joint_states", "none.db3", "is damaged"),
        ("tensors", "code.pt", "'os.system' is not read"),
        ("tensors", "none.pt", "it is damaged"),
    ):
        assert message in sentence_of(convert, converter, tmp_path / name, tmp_path / "out.csv")
    assert not (tmp_path / "out.csv").exists()


def tensor_file(path, tables, rebuild=("torch._utils", "_rebuild_tensor_v2")):
    """Writes a tensor file by hand: opcodes of its dictionary, and the numbers of each storage."""
    out = io.BytesIO()
    out.write(b"\x80\x02}(")
    for key, (name, array) in enumerate(tables.items()):
        out.write(b"X" + struct.pack("<I", len(name)) + name.encode())
        out.write(b"c" + f"{rebuild[0]}\n{rebuild[1]}\n".encode() + b"((")
        out.write(b"X\x07\0\0\0storage" + b"ctorch\nFloatStorage\n")
        out.write(b"X\x01\0\0\0" + str(key).encode() + b"X\x03\0\0\0cpu" + b"J" + struct.pack("<i", array.size) + b"tQ")
        out.write(b"J" + struct.pack("<i", 0))
        for each in (array.shape, [x // 4 for x in array.strides]):
            out.write(b"(" + b"".join(b"J" + struct.pack("<i", x) for x in each) + b"t")
        out.write(b"\x89" + b"ccollections\nOrderedDict\n)R" + b"tR")
    out.write(b"u.")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("traj/data.pkl", out.getvalue())
        for key, array in enumerate(tables.values()):
            archive.writestr(f"traj/data/{key}", array.tobytes(order="A"))


def test_a_tensor_file_becomes_a_table(tmp_path):
    # The second is stored column by column, as a transposed tensor is.
    q, u = np.random.default_rng(0).normal(size=(2, 3, 12)).astype("<f4")
    tables = {"time": np.arange(3, dtype="<f4") / 200, "dof_pos": q, "des_dof_pos": np.asfortranarray(u)}
    tensor_file(tmp_path / "in.pt", tables)
    tensors(tmp_path / "in.pt", tmp_path / "out.csv")
    head, *lines = (tmp_path / "out.csv").read_text(encoding="utf-8").splitlines()
    assert head.startswith("time,q_FL_hip_joint,q_FL_thigh_joint") and head.endswith("u_RR_calf_joint")
    table = np.loadtxt(lines, delimiter=",")
    np.testing.assert_allclose(table, np.column_stack([tables["time"], q, u]), rtol=1e-6)
