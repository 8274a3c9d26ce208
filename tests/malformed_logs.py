"""Logs as tables of text, and logs and mappings with errors: known cases and random ones."""

import json

import numpy as np
from hypothesis import strategies as st

LETTERS = st.characters(exclude_categories=["Cs"])
"""All characters that can be encoded. `st.text()` by default determines them once, which takes three seconds."""

N = 40
T = np.arange(N) / 100
JOINTS = ("ankle", "hip")
Q = np.stack([0.3 * np.sin(5 * T), 0.6 * np.cos(7 * T)], axis=1)
DQ = np.stack([1.5 * np.cos(5 * T), -4.2 * np.sin(7 * T)], axis=1)
WRENCH = np.arange(6 * N).reshape(N, 6) + 0.5
PLAIN = {"time": T, "q_ankle": Q[:, 0], "q_hip": Q[:, 1]}
GROUND_COLUMNS = dict(zip(("ground_fx", "ground_fy", "ground_fz", "ground_mx", "ground_my", "ground_mz"), WRENCH.T))  # noqa: B905


def text(columns, delimiter=",", decimal=".", end="\n"):
    rows = (delimiter.join(repr(float(x)).replace(".", decimal) for x in row) for row in zip(*columns.values()))  # noqa: B905
    return end.join([delimiter.join(columns), *rows, ""])


def replaced(row, column, cell):
    """The plain log with one cell changed; the header is row 1."""
    lines = [line.split(",") for line in text(PLAIN).splitlines()]
    lines[row - 1][list(PLAIN).index(column)] = cell
    return "\n".join(map(",".join, lines))


def retimed(time):
    return text({**PLAIN, "time": time})


def degrees(kind):
    return {**PLAIN, **{f"{kind}_{j}": np.rad2deg(x) for j, x in zip(JOINTS, (Q if kind == "q" else DQ).T)}}  # noqa: B905


BACK = np.where(np.arange(N) == 20, 0.1, T)
BAD_LOGS = {
    "empty": ("", "the file is empty; a log is a header row"),
    "blank": ("\n \n\n", "the file is empty"),
    "comments only": ("# a\n# b", "the file is empty"),
    "only delimiters": (",,,\n,,,\n", "the file is empty"),
    "header only": ("time,q_ankle,q_hip\n", "at least 10 samples, it has 0"),
    "one row": ("time,q_ankle,q_hip\n0,0,0\n", "at least 10 samples, it has 1"),
    "no header": ("\n".join(text(PLAIN).splitlines()[1:]), "header row of names, row 1 holds numbers"),
    "binary": (b"\x89\xff\x00\x01" * 30, "text in UTF-8, a byte 0x89 is not"),
    "latin-1": (text(PLAIN).replace("q_hip", "hüfte").encode("latin-1"), "text in UTF-8, a byte 0xfc is not"),
    "endless quote": (replaced(9, "q_hip", '"0.5'), "row 9 opens a quotation mark that it does not close"),
    "text": (replaced(17, "q_hip", "oops"), "row 17, column 'q_hip' needs a number, got 'oops'"),
    "underscores": (replaced(17, "q_hip", "1_0"), "row 17, column 'q_hip' needs a number, got '1_0'"),
    "units row": (replaced(2, "time", "[s]"), "row 2, column 'time' needs a number, got '[s]'"),
    "row after a comment": ("# c\n" + replaced(5, "q_hip", "?"), "row 6, column 'q_hip' needs a number"),
    "short row": (text(PLAIN) + "0.4,1\n", "row 42 has 2 cells where the header has 3"),
    "long row": (text(PLAIN) + "0.4,1,2,3\n", "row 42 has 4 cells where the header has 3"),
    "decimal commas": (text(PLAIN, ",", ","), "row 2 has 6 cells where the header has 3"),
    "mixed decimals": (
        text(PLAIN, ";", ",").replace("0,01;", "0.01;"),
        "decimal commas (column 'q_ankle') and decimal points (column 'time') in one file are ambiguous",
    ),
    "thousands": (
        text(PLAIN, ";", ",").replace("\n0,01;", "\n1,000,001;"),
        "row 3, column 'time' needs a number, got '1,000,001'",
    ),
    "duplicate": (text(PLAIN).replace("q_ankle", "q_hip"), "names column 'q_hip' more than once"),
    "ambiguous": (text(PLAIN | {"hip": T}), "columns q_hip and hip may both be the position of joint 'hip'; keep one"),
    "two clocks": (text(PLAIN | {"t": T}), "columns time and t may both be time"),
    "no time": (text(PLAIN).replace("time", "zeit"), "as in rate = 100; the file has zeit"),
    "no joint": (
        text(PLAIN).replace("q_hip", "q_knee"),
        "joint 'hip' needs a column of its positions, named hip_position, q_hip, hip or mapped; the file has time, q_a",
    ),
    "NaN": (replaced(9, "q_hip", "nan"), "row 9, column 'q_hip' is empty or NaN, as are 1 of 40 samples"),
    "empty cell": (replaced(9, "q_hip", ""), "row 9, column 'q_hip' is empty or NaN"),
    "NaN run": (text(PLAIN | {"ground_fz": np.where(T > 0.2, np.nan, 1)}), "row 23, column 'ground_fz' is empty"),
    "infinite": (replaced(9, "q_hip", "-inf"), "row 9, column 'q_hip' needs a finite number"),
    "huge": (replaced(9, "q_hip", "1e300"), "row 9, column 'q_hip' needs numbers below 1e+08, got 1e+300"),
    "empty joint": (text({**PLAIN, "q_hip": T * np.nan}), "column 'q_hip' is empty, but joints.hip.position needs it"),
    "empty time": (retimed(T * np.nan), "column 'time' is empty, but a log needs times"),
    "NaN time": (replaced(4, "time", ""), "row 4, column 'time' is empty or NaN"),
    "huge time": (replaced(4, "time", "1e200"), "row 4, column 'time' needs numbers below 1e+12"),
    "back in time": (retimed(BACK), "row 22, column 'time' goes back in time by 0.09 s; sort the log"),
    "unsorted": (retimed(T[::-1]), "row 3, column 'time' goes back in time by 0.01 s"),
    "repeated": (retimed(np.where(np.arange(N) == 20, T[19], T)), "row 22, column 'time' repeats the time"),
    "stopped clock": (text({name: 0 * x for name, x in PLAIN.items()}), "10 samples at different times, it has 1"),
    "gap": (
        retimed(T + (T > 0.2) * 0.03),
        "row 23, column 'time' has a gap of 0.04 s, from 0.2 s to 0.24 s, where",
    ),
    "several gaps": (
        retimed(T + (T > 0.1) * 0.02 + (T > 0.2) * 0.03),
        "row 23, column 'time' has a gap of 0.04 s, from 0.22 s to 0.26 s, where steps are 0.01 s; it is the longest "
        "of 2 gaps. A filter would invent what is missing",
    ),
    "milliseconds": (retimed(1000 * T), "steps of 10 s, which suggests that its unit is not the second"),
    "tiny steps": (retimed(1e-9 * T), "steps of 1e-11 s"),
    "degrees": (text(degrees("q")), "column 'q_hip', the position of joint 'hip', ranges over"),
    "degrees per second": (
        text(degrees("dq") | {"dq_hip": DQ[:, 1]}),
        "the velocity of joint 'ankle' is 57.3 times the derivative of its position",
    ),
    "accelerations in degrees": (
        text(PLAIN | {"dq_ankle": DQ[:, 0], "dq_hip": DQ[:, 1], "ddq_ankle": -430 * np.sin(5 * T), "ddq_hip": T}),
        "the acceleration of joint 'ankle' is 57.3 times the derivative of its velocity",
    ),
}

ENTRY = '[wrenches.ground]\nforce = ["a", "b", "c"]\n'
CONTACT = '[wrenches.grip]\nforce = ["a", "b", "c"]\n'
BAD_MAPPINGS = {
    "no TOML": ("time = = 3", "needs to be TOML in UTF-8"),
    "too deep": ("a = " + "[" * 3000, "needs to be TOML"),
    "too long": ("time = " + "1" * 5000, "needs to be TOML"),
    "unknown entry": (
        "[joint.hip]",
        "the mapping has no entry 'joint'; valid are time, rate, poses, joints, motors, wr",
    ),
    "unknown joint": ('[joints.knee]\nposition = "a"', "[joints] has no entry 'knee'; valid are ankle, hip"),
    "unknown quantity": ('[joints.hip]\nangle = "a"', "[joints.hip] has no entry 'angle'; valid are position, vel"),
    "unknown key": ('time = { colum = "t" }', "time has no entry 'colum'; valid are column, columns, weights"),
    "unknown column": ('time = "zeit"', "time is mapped to column 'zeit', but the file has time, q_ankle, q_hip"),
    "unknown time unit": ('time = { column = "time", unit = "min" }', "time.unit needs one of s, ms, us, ns; got min"),
    "unknown unit": (
        '[joints.hip]\nposition = { column = "q_hip", unit = "degrees" }',
        "joints.hip.position.unit needs one of rad, deg; got degrees",
    ),
    "unit no text": ('time = { column = "time", unit = 3 }', "time.unit needs one of s, ms, us, ns; got 3"),
    "no column": ('[joints.hip]\nposition = { unit = "deg" }', "joints.hip.position needs the name of a column, got"),
    "joints no table": ("joints = 3", "joints needs a table of entries, got 3"),
    "joint no table": ("joints.hip = 3", "joints.hip needs a table of entries, got 3"),
    "wrench no table": ("wrenches.ground = []", "wrenches.ground needs a table of entries, got []"),
    "wrench without columns": ("[wrenches.ground]", "[wrenches.ground] needs at least one column under force or"),
    "two columns": ('[wrenches.ground]\nforce = ["a", "b"]', "wrenches.ground.force needs a list of 3 columns, got"),
    "column no text": ("[wrenches.ground]\nforce = [1, 2, 3]", "wrenches.ground.force needs a list of 3 columns"),
    "wrench unit": (ENTRY + 'unit = "lbf"', "wrenches.ground.unit needs one of N, mN, kN; got lbf"),
    "torque unit": (ENTRY + 'torque_unit = "N"', "wrenches.ground.torque_unit needs one of N m, Nm"),
    "wrench key": (ENTRY + 'link = "leg"', "[wrenches.ground] has no entry 'link'; valid are force, torque"),
    "wrench column": (ENTRY, "wrenches.ground.force is mapped to column 'a', but the file has"),
    "position": (ENTRY + "position = [1, 2]", "wrenches.ground.position needs a list of 3 numbers, got [1, 2]"),
    "position NaN": (ENTRY + "position = [1, 2, nan]", "wrenches.ground.position needs a list of 3 numbers"),
    "position true": (ENTRY + "position = [1, 2, true]", "wrenches.ground.position needs a list of 3 numbers"),
    "quaternion": (ENTRY + "quaternion = [1, 1, 0, 0]", "quaternion needs four numbers w, x, y, z of norm 1"),
    "two rotations": (ENTRY + "quaternion = [1, 0, 0, 0]\nrpy_deg = [0, 0, 0]", "a quaternion or rpy_deg, got both"),
    "body of the ground": (ENTRY + 'body = "leg"', "[wrenches.ground] needs no body: the ground acts at the base"),
    "contact without body": (CONTACT, "[wrenches.grip] needs a body, one of leg, torso; got None"),
    "unknown body": (CONTACT + 'body = "arm"', "[wrenches.grip] needs a body, one of leg, torso; got arm"),
    "sign": (ENTRY + 'applied_to_link = "yes"', "wrenches.ground.applied_to_link needs true or false, got yes"),
    "base without quaternion": ('[base]\nposition = ["a", "b", "c"]', "base.quaternion needs a list of 4 columns"),
    "base with a gap": ('[base]\nposition = ["a", "", "c"]', "base.position needs 3 columns, none of them may be"),
    "base no table": ("base = true", "base needs a table of entries, got True"),
    "column twice": ('[joints.hip]\nposition = "q_ankle"', "column 'q_ankle' is mapped to joints.hip.position and to"),
    "base no rotation": (
        '[base]\nposition = ["x", "y", "z"]\nquaternion = ["x", "y", "z", "w"]',
        "column 'x' is mapped to base.position and to base.quaternion",
    ),
}

SOUND = text(PLAIN | GROUND_COLUMNS)
CELLS = st.one_of(
    st.floats(width=64).map(repr),
    st.sampled_from(["", "nan", "1e308", "-1e9", "5e-324", "0,5", '"', "#", "x", "0", "0.01", "\x00", "1" * 400]),
)
HEADERS = st.lists(
    st.sampled_from(["time", "t", "q_ankle", "ankle", "q_hip", "dq_hip", "tau_hip", "ground_fz", "", "true:t", "a"]),
    max_size=8,
)


@st.composite
def logs(draw):
    """Valid logs with a few cells and bytes changed, and tables of anything."""
    if draw(st.booleans()):
        delimiter = draw(st.sampled_from([",", ";", "\t"]))
        header = draw(HEADERS)
        rows = draw(st.lists(st.lists(CELLS, min_size=len(header), max_size=len(header)), max_size=14))
        return "\n".join(delimiter.join(row) for row in [header, *rows]).encode()
    lines = [line.split(",") for line in SOUND.splitlines()]
    for _ in range(draw(st.integers(0, 3))):
        row, column = draw(st.integers(0, N)), draw(st.integers(0, 8))
        lines[row][column] = draw(CELLS)
    content = bytearray("\n".join(map(",".join, lines)).encode())
    for _ in range(draw(st.integers(0, 2))):
        content[draw(st.integers(0, len(content) - 1))] = draw(st.integers(0, 255))
    return bytes(content)


VALUES = st.recursive(
    st.one_of(
        st.booleans(),
        st.integers(),
        st.floats(),
        st.sampled_from(["time", "q_ankle", "q_hip", "ground_fx", "ground_fy", "deg", "ms", "kN", "leg", "", "no"]),
        st.sampled_from(["plate", "world", "auto", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]]),
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(st.sampled_from(["column", "unit", "position", "force", "body", "hip"]), inner, max_size=3),
    ),
    max_leaves=6,
)


def toml(value):
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(k)} = {toml(x)}" for k, x in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return repr(value) if isinstance(value, float) else json.dumps(value)


@st.composite
def mappings(draw):
    """Valid and invalid entries, sometimes with characters changed."""
    force = st.lists(st.sampled_from(["ground_fx", "ground_fy", "ground_fz", "", "no"]), min_size=2, max_size=4)
    entries = st.sampled_from(["time", "joints", "joints.hip", "joints.hip.position", "base", "wrenches", "x"])
    content = "".join(f"{key} = {toml(draw(VALUES))}\n" for key in draw(st.lists(entries, max_size=2, unique=True)))
    if draw(st.booleans()):
        content += f"[wrenches.ground]\nforce = {toml(draw(force))}\n"
        plate = ("frame", "corners", "origin", "on", "among", "point", "free_moment", "threshold")
        plain = ("unit", "position", "quaternion", "rpy_deg", "body")
        keys = draw(st.lists(st.sampled_from([*plain, *plate]), unique=True))
        content += "".join(f"{key} = {toml(draw(VALUES))}\n" for key in keys)
    if content and draw(st.booleans()):
        i = draw(st.integers(0, len(content) - 1))
        content = content[:i] + draw(st.text(LETTERS, max_size=2)) + content[i + 1 :]
    return content.encode("utf-8", "surrogatepass")
