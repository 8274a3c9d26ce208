"""Each format damaged in ten ways and more: always one sentence, and never another error."""

import numpy as np
import pytest
from commands import sentence_of
from hypothesis import given, settings
from hypothesis import strategies as st
from malformed_logs import JOINTS, LEG, PLAIN, WRENCH, N, Q, T
from written_formats import write_bag, write_c3d, write_csv, write_mat, write_mot, write_parquet, write_trc

from ident import Body, InputError, Mechanism, Tree, read_log

pytestmark = pytest.mark.extras


EXTRAS = {"parquet": ("pyarrow", "parquet"), "c3d": ("ezc3d", "c3d")}
EXTRAS |= dict.fromkeys(("bag", "mcap", "db3"), ("rosbags", "ros"))
KINDS = ("mot", "trc", "mat", "parquet", "csv.gz", "c3d", "bag", "mcap", "db3")
DAMAGES = st.lists(st.tuples(st.floats(0, 1), st.sampled_from("sdi"), st.binary(min_size=1, max_size=9)), max_size=2)
MARKERS = {joint: np.stack([Q[:, k], 0 * T, 0 * T], axis=1) for k, joint in enumerate(JOINTS)}
STATES = {joint: [(x, 0, 0) for x in Q[:, k]] for k, joint in enumerate(JOINTS)}


def needs(kind):
    package, extra = EXTRAS[kind]
    return pytest.importorskip(package, reason=f"{package} is in the extra '{extra}'")


def write(path):
    """Writes a valid file of the format of its end."""
    kind = path.name.split(".", 1)[1]
    if kind in EXTRAS:
        needs(kind)
    if kind == "c3d":
        write_c3d(path, 100.0, MARKERS, WRENCH, JOINTS)
    elif kind in ("bag", "mcap", "db3"):
        target = path if kind == "bag" else path.with_name(f"folder_{kind}")
        write_bag(target, {"/j": (T, STATES)})
        if kind != "bag":
            path.write_bytes(next(target.glob(f"*.{kind}")).read_bytes())
    elif kind == "trc":
        write_trc(path, T, MARKERS)
    else:
        {"mot": write_mot, "mat": write_mat, "parquet": write_parquet, "csv.gz": write_csv}[kind](path, PLAIN)
    return path.read_bytes()


def refusal(path, mapping=None):
    """The error sentence for a log."""
    sentence = sentence_of(read_log, path, LEG, mapping)
    assert sentence.startswith(f"{path}: ") and len(sentence) < 500
    return sentence


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files_are_one_sentence_and_any_file_is_read_or_refused(tmp_path, kind):
    path = tmp_path / f"log.{kind}"
    whole = write(path)
    third, noise = len(whole) // 3, np.random.default_rng(0).integers(256, size=4096, dtype=np.uint8)
    parts = whole[:third], whole[:60], whole[100:], whole[:third] + whole[third + 700 :]
    others = b"", bytes(noise), bytes(len(whole)), b"PK\x03\x04" + bytes(300) + whole[304:], b"This is no log.\n" * 40
    for damaged in (*parts, *others, whole[:30] + b"\xff\xfe\x00" + whole[30:]):
        path.write_bytes(damaged)
        refusal(path)
        assert path.exists()

    @settings(max_examples=20, derandomize=True, deadline=None, database=None)
    @given(damages=DAMAGES)
    def read_or_refused(damages):
        data = bytearray(whole)
        for where, how, new in damages:
            at = int(where * (len(data) - 1)) if len(data) > 1 else 0
            data[at : at + {"s": len(new), "d": 7 * len(new), "i": 0}[how]] = b"" if how == "d" else new
        path.write_bytes(data)
        try:
            read_log(path, LEG)
        except InputError as error:
            assert "\n" not in str(error)

    read_or_refused()


def changed(old, new):
    return lambda text: text.replace(old, new, 1)


TEXTS = [
    ("log.mot", changed("endheader\n", ""), "needs a line 'endheader' before its table; there is none"),
    ("log.mot", changed("nRows=40", "nRows=41"), "promises 41 rows (nrows), the table has 40"),
    ("log.mot", changed("nColumns=3", "nColumns=2"), "promises 2 columns (ncolumns), the table has 3"),
    ("log.mot", changed("inDegrees=yes", "inDegrees=maybe"), "inDegrees needs to be yes or no, got 'maybe'"),
    ("log.mot", lambda text: text[: text.index("time\t")], "the file is empty"),
    ("log.mot", lambda text: text[: text.index("0.0\t")], "the file has no rows after its header"),
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
    ("log.trc", changed("\t0.05\t", "\t\t"), "times of frames must be finite and increase; frame 6 does not"),
    ("log.trc", changed("\t0.05\t", "\t0.05\t1\t"), "row 12 has 9 cells where the labels ask for 8"),
]


@pytest.mark.parametrize(("name", "damage", "message"), TEXTS)
def test_damaged_texts(tmp_path, name, damage, message):
    path = tmp_path / name
    write(path)
    path.write_text(damage(path.read_text()))
    assert message in refusal(path)


def test_bags_that_are_refused(tmp_path):
    needs("bag")
    for name, topics, message in (
        ("none.bag", {}, "a bag needs a topic of sensor_msgs/msg/JointState"),
        ("few.bag", {"/j": (T[:5], STATES)}, "at least 10 samples"),
        ("apart.bag", {"/j": (T, STATES), "/ground": (T + 100, WRENCH)}, "Streams need a time that all of them cover"),
    ):
        write_bag(tmp_path / name, topics)
        assert message in refusal(tmp_path / name)
    write_bag(tmp_path / "folder", {"/j": (T, STATES)})
    path = tmp_path / "folder" / "metadata.yaml"
    metadata = path.read_text()
    for text in ("", "a: [", metadata.replace("sqlite3", "tape"), metadata.replace("folder.db3", "gone.db3")):
        path.write_text(text)
        assert "needs to be a ROS bag" in refusal(path.parent)
    path.unlink()
    assert "the folder needs metadata.yaml" in refusal(path.parent)


def test_c3d_files_that_are_refused(tmp_path):
    ezc3d = needs("c3d")
    path, mapping = tmp_path / "log.c3d", {"joints": {joint: {"position": f"{joint}.x"} for joint in JOINTS}}
    plate = mapping | {"wrenches": {"ground": {"force": [f"plate1_force.{axis}" for axis in "xyz"]}}}
    write(path)
    file = ezc3d.c3d(str(path))
    file["parameters"]["FORCE_PLATFORM"]["TYPE"]["value"] = np.array([99])
    file.write(str(path))
    assert "force is mapped to column 'plate1_force.x', but the file" in refusal(path, plate)
    write_c3d(path, 100.0, {joint: np.full((N, 3), np.nan) for joint in JOINTS}, None, JOINTS)
    assert "column 'ankle.x' is empty, but joints.ankle.position needs it" in refusal(path, mapping)
    data = path.read_bytes()
    path.write_bytes(data[:8] + (60000).to_bytes(2, "little") + data[10:])
    assert "it ends before the 60000 frames that its header promises" in refusal(path, mapping)
    after = data.index(b"RATE") + len(b"RATE")
    path.write_bytes(data[:after] + b"\x01\x00" + data[after + 2 :])
    assert "its parameter RATE goes into the next one" in refusal(path, mapping)
    write_c3d(path, 100.0, {"KNEE": np.stack([T, T, T], axis=1)})
    hand = Mechanism(Tree((Body("hand", -1, np.eye(4), np.zeros(6)),)), np.array([0, 0, -9.81]))
    sentence = sentence_of(read_log, path, hand)
    assert "columns of joints or wrenches, and none is " in sentence and "has KNEE.x, KNEE.y" in sentence
