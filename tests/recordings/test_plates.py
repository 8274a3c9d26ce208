"""Force plates, by entries of a mapping or OpenSim's ExternalLoads in place of one."""

import re

import numpy as np
import pytest
import walker
from commands import sentence_of
from scipy.spatial.transform import Rotation

import ident
import sim
from ident import Body, LogError, Mechanism, Recording, Tree, read_log
from ident.geometry.se3 import pose
from ident.recordings.plates import external_loads
from ident.recordings.stated import read_segments


def placed(turns, position):
    return pose(Rotation.from_euler("xyz", turns, degrees=True).as_matrix(), np.array(position))


PLATES = {
    "right": placed([180, 0, 25], [0.2, -0.2, 0.05]),
    "left": placed([180, 0, -10], [0.1, 0.3, 0.0]),
    "rail": placed([10, 20, 30], [0.4, -0.3, 1.0]),
}
QUADRANTS = np.array([[0.3, 0.2, 0], [-0.3, 0.2, 0], [-0.3, -0.2, 0], [0.3, -0.2, 0]])
CORNERS = {name: (QUADRANTS @ T[:3, :3].T + T[:3, 3]).tolist() for name, T in PLATES.items()}
BELOW = [0.01, -0.02, 0.04]


def axes(name):
    return [f"{name}.{axis}" for axis in "xyz"]


def moments(name, wrench, **entry):
    """Columns of forces and moments, and their entry."""
    columns = {f"{name}_F": wrench[:, :3], f"{name}_M": wrench[:, 3:]}
    return columns, {"force": axes(f"{name}_F"), "torque": axes(f"{name}_M"), **entry}


def at_point(name, force, point, free, entry):
    """Columns of forces, their points and free moments, and their entry."""
    columns = {f"{name}_F": force, f"{name}_p": point, f"{name}_T": free}
    own = {"force": axes(f"{name}_F"), "point": axes(f"{name}_p"), "free_moment": axes(f"{name}_T")}
    return columns, own | entry


def forms(name):
    """Columns and entry of each form in which a wrench on a body can be recorded."""
    T, on, wrench = PLATES[name], walker.TAKEN[name], walker.wrenches()[name]
    local, below = (walker.in_frame(each, wrench) for each in (T, T @ pose(np.eye(3), np.array(BELOW))))
    about_its_middle = walker.in_frame(pose(np.eye(3), T[:3, 3]), wrench)
    point, free = walker.centre_of_pressure(local)
    point = np.column_stack([point, np.zeros(len(point))])
    at = point @ T[:3, :3].T + T[:3, 3]
    quaternion = Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True).tolist()
    world, place = {"frame": "world", "on": on}, {"position": T[:3, 3].tolist()}
    cornered, every = {"frame": "plate", "on": on, "corners": CORNERS[name]}, {"threshold": 0}
    posed = {"frame": "plate", "on": on, **place, "quaternion": quaternion}
    in_mm = {"point": [f"{name}_p.x", f"{name}_p.y", 0.0], "free_moment": ["", "", f"{name}_T"], "point_unit": "mm"}
    return {
        "fixed to the body": moments(name, walker.in_frame(walker.truth()[1][on], wrench), body=on),
        "in the world": moments(name, wrench, **world),
        "about a point": moments(name, about_its_middle, **world, **place),
        "in the plate's axes": moments(name, local, **posed),
        "of the opposite sign": moments(name, -local, **posed, applied_to_link=False),
        "by corners, kN": moments(name, below / np.repeat([1000, 1], 3), **cornered, origin=BELOW, unit="kN"),
        "at a point in mm": at_point(name, local[:, :3], 1000 * point, free, cornered | in_mm | every),
        "at a point of the world": at_point(name, wrench[:, :3], at, free[:, None] * T[:3, 2], world | every),
    }


FORMS = {name: forms(name) for name in PLATES}


def read(columns, mapping, mechanism=None, **options):
    return read_log(walker.columns() | columns, mechanism or walker.mechanism(), mapping, **options)


@pytest.mark.parametrize("form", FORMS["rail"])
def test_every_form_of_a_recording_gives_the_same_total_wrench_also_when_saved(tmp_path, form):
    columns = {key: x for own in FORMS.values() for key, x in own[form][0].items()}
    recording = read(columns, {"wrenches": {name: own[form][1] for name, own in FORMS.items()}})
    assert {name: recording.sensors[name].body for name in walker.TAKEN} == walker.TAKEN
    frame = "body" if form == "fixed to the body" else "world"
    assert {sensor.frame for sensor in recording.sensors.values()} == {frame}
    recording.save(tmp_path / "saved.npz")
    for each in (recording, Recording.load(tmp_path / "saved.npz")):
        wrenches = [each.wrench(name) for name in walker.TAKEN]
        total = ident.total_wrench(walker.mechanism().tree, walker.motion()[1], None, wrenches).values
        np.testing.assert_allclose(total, walker.truth()[0], atol=1e-9 * abs(total).max())


def stepping():
    """Two plates on which the feet alternate, with centres of pressure under the feet; and the foot on each plate."""
    time, places = walker.motion()[0], walker.truth()[1]
    rng = np.random.default_rng(1)
    spans = {"right": [("foot_l", 0.4, 1.1), ("foot_r", 1.3, 2.4), ("foot_l", 4.0, 4.6)], "left": [("foot_r", 0, 0.9)]}
    columns, who = {}, {}
    for name, episodes in spans.items():
        force, point = 5 * rng.normal(size=(len(time), 3)), 50 * rng.standard_cauchy((len(time), 3))
        who[name] = np.full(len(time), "", object)
        for body, start, end in episodes:
            during = (time >= start) & (time < end)
            who[name][during] = body
            force[during] = [30, -20, 600] + 20 * rng.normal(size=(during.sum(), 3))
            point[during] = places[body][during, :3, 3] * [1, 1, 0] + 0.03 * rng.normal(size=(during.sum(), 3))
            # A landing foot hardly presses yet, and its centre of pressure is arbitrary: here, far beyond the other.
            first, other = during.argmax(), places[{"foot_l": "foot_r", "foot_r": "foot_l"}[body]]
            force[first] = [0, 0, 45]
            point[first] += 30 * (other - places[body])[first, :3, 3] * [1, 1, 0]
        empty = who[name] == ""
        point[empty] *= rng.choice([1, np.nan, np.inf, 1e12], p=[0.7, 0.1, 0.1, 0.1], size=(empty.sum(), 1))
        columns |= at_point(name, force, point, rng.normal(size=(len(time), 3)), {})[0]
    return columns, who


def of_stepping(*names, **entry):
    """The mapping of the plates, on which by default the right foot stands."""
    entry = {"frame": "world", "on": "foot_r", **entry}
    return {"wrenches": {name: at_point(name, None, None, None, entry)[1] for name in names}}


@pytest.mark.parametrize("lost", [[], [7, 180, 181, 182, 420]])
def test_who_stands_on_which_plate_is_found_and_steps_on_and_off(lost):
    columns, who = ({name: np.delete(x, lost, axis=0) for name, x in given.items()} for given in stepping())
    times = {name: np.delete(x, lost) for name, x in walker.columns().items()}
    mapping = of_stepping("right", "left", on="auto", among=["foot_r", "foot_l"], threshold=40)
    recording = read(times | columns, mapping, gaps=bool(lost))
    assert set(recording.wrenches) == {f"{body} on {name}" for name in who for body in ("foot_r", "foot_l")}
    for name in recording.wrenches:
        body, _, plate = name.partition(" on ")
        assert (recording.sensors[name].body, recording.sensors[name].plate) == (body, plate)
        expected = np.where((who[plate] == body)[:, None], columns[f"{plate}_F"], 0)
        np.testing.assert_allclose(recording.as_measured(f"{name}_force").values, expected, atol=1e-9)
        assert np.isfinite(recording[f"{name}_torque"]).all()
    notes = " ".join(recording.notes)
    assert "By its force, on 'right' is foot_l from 0.40 to 1.09 s, foot_r from 1.30 to 2.39 s" in notes
    assert "on 'left' is foot_r from 0.00 to 0.89 s." in notes and "nearly as near" not in notes
    assert "nor is its point of application used" in notes and "at most 40 N" in notes


@pytest.mark.parametrize(
    ("unloaded", "point", "stated", "left"),
    [
        ("fades", 1.0, {}, True),
        ("fades", 1.0, {"threshold": 20}, False),
        ("fades", np.nan, {}, False),
        ("fades", 0.0, {}, False),
        ("fades", np.nan, {"point": [0.1, 0.2, 0.0]}, True),
        ("noise", 1.0, {}, False),
        ("noise", 1.0, {"threshold": 0}, True),
        ("zero", 1.0, {}, False),
    ],
)
def test_small_forces_count_where_the_recording_has_no_noise(unloaded, point, stated, left):
    """A force rises in six samples, of 1 to 16 N, after 300 in which it is not there."""
    columns, rng = stepping()[0], np.random.default_rng(0)
    force, points = np.tile([0, 0, 700.0], (600, 1)), np.ones((600, 3))
    force[:300] = rng.normal(size=(300, 3)) if unloaded == "noise" else 0
    force[:300, 2] += 10.0 ** -np.linspace(0, 4, 300) if unloaded == "fades" else 0
    force[300:306], points[300:306] = np.outer([1, 2, 4, 8, 12, 16], [0, 0, 1]), point
    recording = read(columns | {"right_F": force, "right_p": points}, of_stepping("right", **stated))
    np.testing.assert_array_equal(recording.as_measured("right_force").values[300:306, 2] > 0, left)
    some, every = (sum(words in note for note in recording.notes) for words in ("counts as nothing", "All forces of"))
    assert some == (not left) and every == (left and "threshold" not in stated)


def test_moments_without_forces_count_whatever_the_threshold():
    columns, entry = FORMS["right"]["in the plate's axes"]
    entry = {key: value for key, value in entry.items() if key != "force"} | {"threshold": 40}
    np.testing.assert_array_equal(read(columns, {"wrenches": {"right": entry}})["right_torque"], columns["right_M"])


def test_a_point_that_is_missing_under_a_load_is_named():
    columns, _ = stepping()
    columns["right_p"][np.flatnonzero(walker.motion()[0] > 2)[:3]] = np.nan
    with pytest.raises(LogError, match=r"sample 20[12], wrenches.right.point is missing, as in 3 of 600 samples"):
        read(columns, of_stepping("right", "left", threshold=40))


ARM, WORLD, PLATE = {"body": "arm"}, {"frame": "world"}, {"frame": "plate", "on": "foot_r"}
SQUARE = PLATE | {"corners": CORNERS["right"]}
POINT = {"point": ["x", "y", 0], "free_moment": ["", "", "t"]}
AUTO, RECTANGLE = WORLD | {"on": "auto"}, "needs the corners of a rectangle"
BAD = [
    (ARM | POINT, '\'point\', which takes a frame that rests: "plate" or "world"'),
    ({"on": "arm"}, "[wrenches.p] has 'on', which takes a frame that rests"),
    (WORLD | ARM, "rests in the world: the body that touches it is stated by 'on'"),
    (WORLD, "wrenches.p.on needs one of pelvis"),
    (WORLD | {"on": "hand"}, "arm, auto; got hand"),
    (AUTO, 'wrenches.p.among, which on = "auto" needs, is a list of the two bodies'),
    (WORLD | {"on": "arm", "among": ["arm", "foot_r"]}, 'among belongs to on = "auto"; got on ='),
    (WORLD | {"on": "arm", "rpy_deg": [0, 0, 9]}, "'rpy_deg' would turn them: say frame"),
    (PLATE, "[wrenches.p] needs the plate's pose in the world: 'position' with a rotation, or 'corners'"),
    (SQUARE | {"position": [0, 0, 0]}, "[wrenches.p] needs 'corners' or 'position', got both"),
    (PLATE | {"position": [0, 0, 0], "origin": [0, 0, 0]}, "wrenches.p.origin belongs to 'corners'"),
    (PLATE | {"corners": [[0, 0, 0], [1, 0, 0], [1, 1, 0]]}, "wrenches.p.corners needs four points"),
    (PLATE | {"corners": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1.1, 0]]}, RECTANGLE),
    (PLATE | {"corners": [[0, 0, 0], [1, 0, 0], [1.3, 1, 0], [0.3, 1, 0]]}, RECTANGLE),
    (SQUARE | {"point": ["x", "y", 0]}, "[wrenches.p] has 'point' without 'free_moment'"),
    (SQUARE | {"free_moment": ["", "", "t"]}, "[wrenches.p] has 'free_moment' without 'point'"),
    (SQUARE | POINT | {"torque": ["d", "e", "f"]}, "'torque', moments about its origin, or"),
    (SQUARE | POINT | {"point": ["x", "", 0]}, "wrenches.p.point needs three coordinates, each a col"),
    (SQUARE | POINT | {"free_moment": ["", "", ""]}, "wrenches.p.free_moment needs columns beside a point"),
    (WORLD | {"on": "foot_r"} | POINT | {"position": [0, 0, 1]}, "no use for 'position'"),
    (SQUARE | {"threshold": -1}, "wrenches.p.threshold needs a force in N, zero or more; got -1"),
]


@pytest.mark.parametrize(("entry", "message"), BAD)
def test_wrong_entries_are_refused_in_one_sentence(entry, message):
    assert message in sentence_of(read, {}, {"wrenches": {"p": {"force": ["a", "b", "c"], **entry}}})


@pytest.mark.parametrize(
    ("more", "base", "message"),
    [
        ({"on": "arm"}, {}, "[wrenches.ground] needs no 'on': the ground acts at the base; got arm"),
        ({}, {}, "[wrenches.ground] rests in the world while the base moves: give it another name"),
        ({}, {"held": "no"}, "base.held needs true or false, got no"),
    ],
)
def test_a_ground_has_no_body_and_a_base_that_moves_no_ground_in_the_world(more, base, message):
    (total, places), person = walker.truth(), sim.mechanism(walker.mechanism().source.text, base="pelvis")
    columns, entry = moments("ground", total, frame="world", **more)
    columns |= {"p": places["pelvis"][:, :3, 3], "q": np.tile([1.0, 0, 0, 0], (600, 1))}
    base |= {"position": axes("p"), "quaternion": [f"q.{x}" for x in "wxyz"]}
    assert message in sentence_of(read, columns, {"wrenches": {"ground": entry}, "base": base}, person)


TORQUE, IDLE = "<torque_identifier>{}_m</torque_identifier>", "<appliesForce>false</appliesForce>"


def force(name, body, frame="ground", more=TORQUE):
    return f"""<ExternalForce name="{name}"><applied_to_body>{body}</applied_to_body>{more.format(name)}
        <force_expressed_in_body>{frame}</force_expressed_in_body><force_identifier>{name}_v</force_identifier>
        <point_expressed_in_body>ground</point_expressed_in_body><point_identifier>{name}_p</point_identifier>
        </ExternalForce>"""


def loads(*forces):
    inner = f'<ExternalLoads name="walk"><objects>{"".join(forces)}</objects></ExternalLoads>'
    return f'<OpenSimDocument Version="40000">{inner}</OpenSimDocument>'


def loaded(path, text, bodies):
    if text is not None:
        path.write_text(text, encoding="utf-8")
    return external_loads(path, bodies)


def test_plates_are_under_the_feet_that_the_file_names(tmp_path):
    """Forces of 100 N on plates called a and b, under two feet that slide along x."""
    path, t = tmp_path / "loads.xml", np.arange(40) / 100
    columns, bodies = {"time": t, "foot_r_x": 0 * t, "foot_l_x": 0 * t}, []
    for name, body, z in (("a", "foot_r", 0.1), ("b", "foot_l", -0.1)):
        bodies.append(Body(body, -1, placed([0, 0, 0], [0, 0, z]), np.eye(6)[0], f"{body}_x"))
        for kind, values in {"v": (0, 100, 0), "p": (0.01, 0, z), "m": (0, 0.5, 0)}.items():
            columns |= {f"{name}_{kind}{axis}": 0 * t + x for axis, x in zip("xyz", values, strict=True)}
    path.write_text(loads(force("a", "/bodyset/foot_r"), force("b", "foot_l")), encoding="utf-8")
    log = read_log(columns, Mechanism(Tree(tuple(bodies)), np.array([0, -9.81, 0])), path)
    for name in ("foot_r on a", "foot_l on b"):
        assert np.linalg.norm(log[f"{name}_force"][0]) == pytest.approx(100)
    assert not log["foot_l on a_force"].any() and not any("expected" in note for note in log.notes)
    assert read_segments(path) is None


def test_forces_that_do_not_act_are_left_out_also_where_the_loads_are_the_whole_document(tmp_path):
    text = loads(force("a", "foot_r"), force("b", "foot_l", more=TORQUE + IDLE))
    entries = loaded(tmp_path / "x.xml", re.sub("</?OpenSimDocument.*?>", "", text), ("foot_r",))["wrenches"]
    assert {name: entry["on"] for name, entry in entries.items()} == {"a": "foot_r"}


def test_loads_that_cannot_be_taken_are_refused(tmp_path):
    for text, message in (
        (None, "are an XML file that exists"),
        (loads(), "have an <ExternalForce> that acts, this <OpenSimDocument> has none"),
        (loads(force("a", "toes")), "\"a\"> acts on 'toes', which is no body of the model; those are foot_r, foot_l"),
        (loads(force("a", "foot_r", "foot_r")), "needs the ground as its force_expressed_in_body, got 'foot_r'"),
        (loads(force("a", "foot_r", more="")), "needs a <torque_identifier>"),
        (loads(force("a", "foot_r"), force("a", "foot_l")), "every <ExternalForce> needs a name of its own"),
        ("<OpenSimDocument>", "the file needs to be XML"),
    ):
        with pytest.raises(LogError, match=rf"loads\.xml.*{message}"):
            loaded(tmp_path / "loads.xml", text, ("foot_r", "foot_l"))
