"""Each format damaged in ten ways and more: always one sentence, and never another error."""

import re

import numpy as np
import pytest
from commands import sentence_of
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from malformed_logs import JOINTS, LEG, PLAIN, WRENCH, N, Q, T
from written_formats import write_bag, write_c3d, write_csv, write_mat, write_mot, write_parquet, write_trc

from ident.errors import InputError, LogError
from ident.mechanism.body import Body
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.recordings.log import read_log

pytestmark = pytest.mark.extras


EXTRAS = {"parquet": ("pyarrow", "parquet"), "c3d": ("ezc3d", "c3d")}
EXTRAS |= dict.fromkeys(("bag", "mcap", "db3"), ("rosbags", "ros"))


def _markers(columns):
    return {joint: np.stack([columns[f"q_{joint}"], 0 * T, 0 * T], axis=1) for joint in JOINTS}


def write(path, columns=PLAIN):
    """Writes a valid file of each format, optionally with other numbers."""
    kind = path.name.split(".", 1)[1]
    if kind in EXTRAS:
        package, extra = EXTRAS[kind]
        pytest.importorskip(package, reason=f"{package} is in the extra '{extra}'")
    if kind == "c3d":
        write_c3d(path, 100.0, _markers(columns), WRENCH, JOINTS)
    elif kind in ("bag", "mcap", "db3"):
        states = {joint: [(x, 0, 0) for x in columns[f"q_{joint}"]] for joint in JOINTS}
        target = path if kind == "bag" else path.with_name(f"folder_{kind}")
        write_bag(target, {"/j": (columns["time"], states)})
        if kind != "bag":
            path.write_bytes(next(target.glob(f"*.{kind}")).read_bytes())
    elif kind == "trc":
        write_trc(path, T, _markers(columns))
    else:
        writers = {"mot": write_mot, "mat": write_mat, "parquet": write_parquet, "csv.gz": write_csv}
        writers[kind](path, columns)


def refusal(path, mapping=None):
    """The error sentence for a log."""
    sentence = sentence_of(read_log, path, LEG, mapping)
    assert sentence.startswith(f"{path}: ") and len(sentence) < 500
    return sentence


WAYS = {
    "empty": lambda data: b"",
    "garbage": lambda data: bytes(np.random.default_rng(0).integers(256, size=4096, dtype=np.uint8)),
    "zeros": lambda data: bytes(len(data)),
    "half": lambda data: data[: len(data) // 2],
    "its first bytes": lambda data: data[:60],
    "without its beginning": lambda data: data[100:],
    "another format": lambda data: b"PK\x03\x04" + bytes(300) + data[304:],
    "a text": lambda data: b"This is no log.\n" * 40,
    "a hole": lambda data: data[: len(data) // 3] + data[len(data) // 3 + 700 :],
    "shifted": lambda data: data[:30] + b"\xff\xfe\x00" + data[30:],
}
KINDS = ("mot", "trc", "mat", "parquet", "csv.gz", "c3d", "bag", "mcap", "db3")


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS.keys())
@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files_are_one_sentence(tmp_path, kind, way):
    path = tmp_path / f"log.{kind}"
    write(path)
    path.write_bytes(way(path.read_bytes()))
    refusal(path)
    assert path.exists()


DAMAGES = st.lists(st.tuples(st.floats(0, 1), st.sampled_from("sdi"), st.binary(min_size=1, max_size=9)), max_size=2)


@settings(
    max_examples=20,
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@pytest.mark.parametrize("kind", KINDS)
@given(damages=DAMAGES)
def test_any_file_is_read_or_refused(tmp_path, kind, damages):
    path = tmp_path / f"log.{kind}"
    if not (tmp_path / kind).exists():
        write(path)
        (tmp_path / kind).write_bytes(path.read_bytes())
    data = bytearray((tmp_path / kind).read_bytes())
    for where, how, new in damages:
        at = int(where * (len(data) - 1)) if len(data) > 1 else 0
        data[at : at + {"s": len(new), "d": 7 * len(new), "i": 0}[how]] = b"" if how == "d" else new
    path.write_bytes(data)
    try:
        read_log(path, LEG)
    except InputError as error:
        assert "\n" not in str(error)


def changed(old, new):
    return lambda text: text.replace(old, new, 1)


MOT = [
    ("log.mot", changed("endheader\n", ""), "needs a line 'endheader' before its table; there is none"),
    ("log.mot", changed("nRows=40", "nRows=41"), "promises 41 rows (nrows), the table has 40"),
    ("log.mot", changed("nColumns=3", "nColumns=2"), "promises 2 columns (ncolumns), the table has 3"),
    ("log.mot", changed("nRows=40", "nRows=many"), "promises many rows"),
    ("log.mot", changed("inDegrees=yes", "inDegrees=maybe"), "inDegrees needs to be yes or no, got 'maybe'"),
    ("log.mot", lambda text: text[: text.index("time\t")], "the file is empty"),
    ("log.mot", lambda text: text[: text.index("0.0\t")], "the file has no rows after its header"),
]


def sixth(x, y):
    """The first marker at another place in the sixth frame."""
    return lambda text: re.sub(r"(\n6\t0\.05\t)[^\t]*\t[^\t]*", rf"\g<1>{x}\t{y}", text)


TRC = [
    ("log.trc", changed("PathFileType", "FileType"), "a .trc file begins with PathFileType"),
    ("log.trc", changed("Units", "Unit"), "needs DataRate, NumFrames, NumMarkers, Units; it lacks Units"),
    ("log.trc", changed("\tmm", "\tft"), "need to be one of m, cm, mm, meters, centimeters, millimeters; got ft"),
    ("log.trc", changed("100\t", "0\t"), "the DataRate of a .trc file needs to be positive, the file says 0 Hz"),
    ("log.trc", changed("100\t", "250\t"), "promises 250 Hz, but frames are 0.01 s apart"),
    ("log.trc", changed("\t40\t", "\t41\t"), "promises 41 as NumFrames, the file has 40"),
    ("log.trc", changed("\t2\tmm", "\t3\tmm"), "promises 3 as NumMarkers, the file has 2"),
    ("log.trc", changed("ankle", "hip"), "markers need different labels, 'hip' is given to more than one"),
    ("log.trc", changed("\t0.05\t", "\tlate\t"), "row 12 needs finite numbers, got 'late'"),
    ("log.trc", changed("Frame#", "Image"), "row 4 of a .trc file begins with Frame# and Time, got 'Image'"),
    ("log.trc", changed("\t0.05\t", "\tinf\t"), "row 12 needs finite numbers, got 'inf'"),
    ("log.trc", sixth("1", ""), "frame 6: marker 'ankle' has some of x, y and z only"),
    ("log.trc", sixth("9e30", "0"), "frame 6: marker 'ankle' needs positions below"),
    ("log.trc", changed("\t0.05\t", "\t\t"), "times of frames must be finite and increase; frame 6 does not"),
    ("log.trc", changed("\t0.05\t", "\t0.05\t1\t"), "row 12 has 9 cells where the labels ask for 8"),
]


@pytest.mark.parametrize(("name", "damage", "message"), [*MOT, *TRC])
def test_damaged_texts(tmp_path, name, damage, message):
    path = tmp_path / name
    write(path)
    path.write_text(damage(path.read_text()))
    assert message in refusal(path)


def test_bags_that_are_refused(tmp_path):
    pytest.importorskip("rosbags", reason="rosbags is in the extra 'ros'")
    states = {joint: [(x, 0, 0) for x in Q[:, k]] for k, joint in enumerate(JOINTS)}
    write_bag(tmp_path / "none.bag", {})
    assert "a bag needs a topic of sensor_msgs/msg/JointState" in refusal(tmp_path / "none.bag")
    write_bag(tmp_path / "few.bag", {"/j": (T[:5], states)})
    assert "at least 10 samples" in refusal(tmp_path / "few.bag")
    early, late = (T, states), (T + 100, WRENCH)
    write_bag(tmp_path / "apart.bag", {"/j": early, "/ground": late})
    assert "Streams need a time that all of them cover" in refusal(tmp_path / "apart.bag")
    write_bag(tmp_path / "folder", {"/j": early})
    metadata = (tmp_path / "folder" / "metadata.yaml").read_text()
    for text in ("", "a: [", metadata.replace("sqlite3", "tape"), metadata.replace("folder.db3", "gone.db3")):
        (tmp_path / "folder" / "metadata.yaml").write_text(text)
        assert "needs to be a ROS bag" in refusal(tmp_path / "folder")
    (tmp_path / "folder" / "metadata.yaml").unlink()
    assert "the folder needs metadata.yaml" in refusal(tmp_path / "folder")


def test_c3d_files_that_are_refused(tmp_path):
    ezc3d = pytest.importorskip("ezc3d", reason="ezc3d is in the extra 'c3d'")
    path, mapping = tmp_path / "log.c3d", {"joints": {joint: {"position": f"{joint}.x"} for joint in JOINTS}}

    def rewritten(group, entry, value):
        write(path)
        file = ezc3d.c3d(str(path))
        file["parameters"][group][entry]["value"] = value
        file.write(str(path))

    rewritten("POINT", "LABELS", ["hip", "hip"])
    assert "markers need different labels, 'hip' is given to more than one" in refusal(path, mapping)
    rewritten("FORCE_PLATFORM", "TYPE", np.array([99]))
    plate = mapping | {"wrenches": {"ground": {"force": [f"plate1_force.{axis}" for axis in "xyz"]}}}
    assert "wrenches.ground.force is mapped to column 'plate1_force.x', but the file has" in refusal(path, plate)
    write_c3d(path, 100.0, {joint: np.full((N, 3), np.nan) for joint in JOINTS}, None, JOINTS)
    assert "column 'ankle.x' is empty, but joints.ankle.position needs it" in refusal(path, mapping)
    data = bytearray(path.read_bytes())
    data[8:10] = (60000).to_bytes(2, "little")
    path.write_bytes(data)
    assert "it ends before the 60000 frames that its header promises" in refusal(path, mapping)


def test_a_file_without_wrenches_is_refused_where_there_are_no_joints(tmp_path):
    pytest.importorskip("ezc3d", reason="ezc3d is in the extra 'c3d'")
    path = tmp_path / "log.c3d"
    write_c3d(path, 100.0, {"KNEE": np.stack([T, T, T], axis=1)})
    hand = Mechanism(Tree((Body("hand", -1, np.eye(4), np.zeros(6)),)), np.array([0, 0, -9.81]))
    with pytest.raises(LogError, match=r"columns of joints or wrenches, and none is .*has KNEE\.x, KNEE\.y"):
        read_log(path, hand)
