"""Force plates, by entries of a mapping or OpenSim's ExternalLoads in place of one."""

import numpy as np
import pytest
import walker
from commands import sentence_of
from scipy.spatial.transform import Rotation
from written_formats import write_csv

import ident
import sim
from ident.errors import LogError
from ident.geometry.se3 import pose
from ident.mechanism.body import Body
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.recordings.entries import read_segments
from ident.recordings.log import read_log
from ident.recordings.plates import external_loads
from ident.recordings.recording import Recording


def placed(turns, position):
    return pose(Rotation.from_euler("xyz", turns, degrees=True).as_matrix(), np.array(position))


PLATES = {
    "right": placed([180, 0, 25], [0.2, -0.2, 0.05]),
    "left": placed([180, 0, -10], [0.1, 0.3, 0.0]),
    "rail": placed([10, 20, 30], [0.4, -0.3, 1.0]),
}
QUADRANTS = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])


def corners(T, size=(0.3, 0.2)):
    """Corners of a plate in the order of its quadrants."""
    local = np.hstack([QUADRANTS * size, np.zeros((4, 1))])
    return (local @ T[:3, :3].T + T[:3, 3]).tolist()


def as_posed(T):
    return f"position = {T[:3, 3].tolist()}\nquaternion = {_quaternion(T)}\n"


def _quaternion(T):
    return Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True).tolist()


def named(name, letter, values):
    return {f"{name}_{letter}{axis}": x for axis, x in zip("xyz", values.T, strict=True)}


def listed(name, letter):
    return str([f"{name}_{letter}{axis}" for axis in "xyz"])


def plain(name, wrench):
    """Columns of forces and moments, and their mapping."""
    text = f"[wrenches.{name}]\nforce = {listed(name, 'F')}\ntorque = {listed(name, 'M')}\n"
    return named(name, "F", wrench[:, :3]) | named(name, "M", wrench[:, 3:]), text


def fixed_to_the_body(name, wrench, body):
    columns, text = plain(name, walker.in_frame(walker.truth()[1][body], wrench))
    return columns, f'{text}body = "{body}"\n'


def in_world(name, wrench, body):
    columns, text = plain(name, wrench)
    return columns, f'{text}frame = "world"\non = "{body}"\n'


def about_a_point(name, wrench, body):
    columns, text = plain(name, walker.in_frame(pose(np.eye(3), PLATES[name][:3, 3]), wrench))
    return columns, f'{text}frame = "world"\non = "{body}"\nposition = {PLATES[name][:3, 3].tolist()}\n'


def in_plate(name, wrench, body):
    columns, text = plain(name, walker.in_frame(PLATES[name], wrench))
    return columns, f'{text}frame = "plate"\non = "{body}"\n{as_posed(PLATES[name])}'


def reversed_(name, wrench, body):
    columns, text = in_plate(name, -wrench, body)
    return columns, f"{text}applied_to_link = false\n"


def by_corners(name, wrench, body):
    """Moments about a point below the middle of the surface, forces in kN."""
    T = PLATES[name] @ pose(np.eye(3), np.array([0.01, -0.02, 0.04]))
    columns, text = plain(name, walker.in_frame(T, wrench))
    columns = {key: x / 1000 if "_F" in key else x for key, x in columns.items()}
    text += f'frame = "plate"\non = "{body}"\ncorners = {corners(PLATES[name])}\norigin = [0.01, -0.02, 0.04]\n'
    return columns, f'{text}unit = "kN"\n'


def at_a_point(name, wrench, body):
    """Centre of pressure in mm, with the moment about the plate's normal."""
    local = walker.in_frame(PLATES[name], wrench)
    point, free = walker.centre_of_pressure(local)
    columns = named(name, "F", local[:, :3]) | {f"{name}_x": 1000 * point[:, 0], f"{name}_y": 1000 * point[:, 1]}
    columns[f"{name}_Tz"] = free
    text = f'[wrenches.{name}]\nforce = {listed(name, "F")}\nframe = "plate"\non = "{body}"\nthreshold = 0\n'
    text += f'point = ["{name}_x", "{name}_y", 0.0]\npoint_unit = "mm"\nfree_moment = ["", "", "{name}_Tz"]\n'
    return columns, f"{text}corners = {corners(PLATES[name])}\n"


def at_a_point_in_world(name, wrench, body):
    """The same in the world's axes, as in exports of gait laboratories."""
    T = PLATES[name]
    local = walker.in_frame(T, wrench)
    point, free = walker.centre_of_pressure(local)
    at = np.column_stack([point, np.zeros(len(point))]) @ T[:3, :3].T + T[:3, 3]
    columns = named(name, "F", wrench[:, :3]) | named(name, "p", at) | named(name, "T", free[:, None] * T[:3, 2])
    text = f'[wrenches.{name}]\nforce = {listed(name, "F")}\nframe = "world"\non = "{body}"\nthreshold = 0\n'
    return columns, f"{text}point = {listed(name, 'p')}\nfree_moment = {listed(name, 'T')}\n"


FORMS = (in_world, about_a_point, in_plate, reversed_, by_corners, at_a_point, at_a_point_in_world)


def written(folder, parts, base=None):
    """Writes log and mapping."""
    columns = walker.columns() | {key: x for columns, _ in parts for key, x in columns.items()}
    text = "\n".join(text for _, text in parts)
    if base is not None:
        turns = Rotation.from_matrix(base[:, :3, :3]).as_quat(scalar_first=True)
        columns |= dict(zip("XYZ", base[:, :3, 3].T, strict=True)) | dict(zip("wxyz", turns.T, strict=True))
        text += '\n[base]\nposition = ["X", "Y", "Z"]\nquaternion = ["w", "x", "y", "z"]\n'
    folder.mkdir(exist_ok=True)
    np.savez(folder / "log.npz", **columns)
    (folder / "columns.toml").write_text(text.replace("'", '"'), encoding="utf-8")
    return folder / "log.npz", folder / "columns.toml"


def read(folder, form, base=None, mechanism=None):
    parts = [form(name, wrench, walker.TAKEN[name]) for name, wrench in walker.wrenches().items()]
    log, columns = written(folder, parts, base)
    return ident.read_log(log, mechanism or walker.mechanism(), columns)


def least_squares(recording):
    return ident.least_squares(ident.Equations.of_wrench(walker.mechanism()), recording)


def test_every_form_of_a_recording_gives_the_same_estimate(tmp_path):
    reference = read(tmp_path, fixed_to_the_body)
    fit = least_squares(reference)
    truth = fit.parameters.regroup(walker.mechanism().known)
    np.testing.assert_allclose(fit.psi, truth, atol=1e-9 * abs(truth).max())
    for form in FORMS:
        recording = read(tmp_path, form)
        own = least_squares(recording)
        np.testing.assert_allclose(own.psi, fit.psi, atol=1e-9 * abs(fit.psi).max(), err_msg=form.__name__)
        there = [recording.sensors[name].frame for name in walker.TAKEN]
        assert there == ["world"] * 3
        for name, body in walker.TAKEN.items():
            assert recording.sensors[name].body == body
        recording.save(tmp_path / "saved.npz")
        again = Recording.load(tmp_path / "saved.npz")
        np.testing.assert_array_equal(least_squares(again).psi, own.psi)


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
        columns |= named(name, "F", force) | named(name, "p", point) | {f"{name}_T": rng.normal(size=len(time))}
    return columns, who


def of_stepping(on):
    return "\n".join(
        f'[wrenches.{name}]\nforce = {listed(name, "F")}\npoint = {listed(name, "p")}\nframe = "world"\n'
        f'free_moment = ["", "", "{name}_T"]\n{on}\nthreshold = 40\n'
        for name in ("right", "left")
    )


@pytest.mark.parametrize("lost", [False, True])
def test_who_stands_on_which_plate_is_found_and_steps_on_and_off(tmp_path, lost):
    columns, who = stepping()
    log, mapping = written(tmp_path, [(columns, of_stepping('on = "auto"\namong = ["foot_r", "foot_l"]'))])
    if lost:
        kept = {key: np.delete(x, [7, 180, 181, 182, 420]) for key, x in np.load(log).items()}
        np.savez(log, **kept)
        who = {name: np.delete(x, [7, 180, 181, 182, 420]) for name, x in who.items()}
    recording = ident.read_log(log, walker.mechanism(), mapping, gaps=lost)
    assert set(recording.wrenches) == {f"{body} on {name}" for name in who for body in ("foot_r", "foot_l")}
    force = {name: np.stack([np.load(log)[f"{name}_F{axis}"] for axis in "xyz"], axis=1) for name in who}
    for name in recording.wrenches:
        body, _, plate = name.partition(" on ")
        assert (recording.sensors[name].body, recording.sensors[name].plate) == (body, plate)
        expected = np.where((who[plate] == body)[:, None], force[plate], 0)
        np.testing.assert_allclose(recording.as_measured(f"{name}_force").values, expected, atol=1e-9)
        assert np.isfinite(recording[f"{name}_torque"]).all()
    notes = " ".join(recording.notes)
    assert "By its force, on 'right' is foot_l from 0.40 to 1.09 s, foot_r from 1.30 to 2.39 s" in notes
    assert "on 'left' is foot_r from 0.00 to 0.89 s." in notes
    assert "nearly as near" not in notes
    assert "nor is its point of application used" in notes and "at most 40 N" in notes


@pytest.mark.parametrize(
    ("unloaded", "point", "stated", "left"),
    [
        ("fades", 1.0, "", True),  # a simulated contact
        ("fades", 1.0, "threshold = 20", False),
        ("fades", np.nan, "", False),  # without points where forces are small
        ("fades", 0.0, "", False),
        ("noise", 1.0, "", False),
        ("noise", 1.0, "threshold = 0", True),
        ("zero", 1.0, "", False),
    ],
)
def test_small_forces_count_where_the_recording_has_no_noise(tmp_path, unloaded, point, stated, left):
    """A force rises in six samples, of 1 to 16 N, after 300 in which it is not there."""
    columns, rng = stepping()[0], np.random.default_rng(0)
    count = len(columns["right_T"])
    force, points = np.tile([0, 0, 700.0], (count, 1)), np.ones((count, 3))
    force[:300] = rng.normal(size=(300, 3)) if unloaded == "noise" else 0
    force[:300, 2] += 10.0 ** -np.linspace(0, 4, 300) if unloaded == "fades" else 0
    force[300:306], points[300:306] = np.outer([1, 2, 4, 8, 12, 16], [0, 0, 1]), point
    columns |= named("right", "F", force) | named("right", "p", points)
    text = of_stepping('on = "foot_r"').replace("threshold = 40", stated).partition("[wrenches.left]")[0]
    log, mapping = written(tmp_path, [(columns, text)])
    recording = ident.read_log(log, walker.mechanism(), mapping)
    np.testing.assert_array_equal(recording.as_measured("right_force").values[300:306, 2] > 0, left)
    some, every = (sum(words in note for note in recording.notes) for words in ("counts as nothing", "All forces of"))
    assert some == (not left) and every == (left and not stated)


def test_small_forces_count_at_a_point_that_is_stated(tmp_path):
    columns, count = stepping()[0], len(stepping()[0]["right_T"])
    columns |= named(
        "right", "F", np.outer(np.append(10.0 ** -np.linspace(-1, 4, 300), np.full(count - 300, 700)), [0, 0, 1])
    )
    text = of_stepping('on = "foot_r"').replace("threshold = 40", "").partition("[wrenches.left]")[0]
    text = text.replace(f"point = {listed('right', 'p')}", "point = [0.1, 0.2, 0.0]")
    log, mapping = written(tmp_path, [(columns, text)])
    recording = ident.read_log(log, walker.mechanism(), mapping)
    assert (recording.as_measured("right_force").values[:300, 2] > 0).all()


def test_moments_without_forces_count_whatever_the_threshold(tmp_path):
    columns, text = in_plate("right", walker.wrenches()["right"], walker.TAKEN["right"])
    text = text.replace(f"force = {listed('right', 'F')}\n", "") + "threshold = 40\n"
    recording = ident.read_log(written(tmp_path, [(columns, text)])[0], walker.mechanism(), tmp_path / "columns.toml")
    moments = np.stack([columns[f"right_M{axis}"] for axis in "xyz"], axis=1)
    np.testing.assert_array_equal(recording["right_torque"], moments)


def test_a_point_that_is_missing_under_a_load_is_named(tmp_path):
    columns, _ = stepping()
    columns["right_px"][np.flatnonzero(walker.motion()[0] > 2)[:3]] = np.nan
    log, mapping = written(tmp_path, [(columns, of_stepping('on = "foot_r"'))])
    with pytest.raises(ident.LogError, match=r"sample 20[12], wrenches.right.point is missing, as in 3 of 600 samples"):
        ident.read_log(log, walker.mechanism(), mapping)


HEAD = '[wrenches.p]\nforce = ["a", "b", "c"]\n'
CORNERS = f"corners = {corners(PLATES['right'])}\n"
ON = 'frame = "plate"\non = "foot_r"\n'
POINT = 'point = ["x", "y", 0]\nfree_moment = ["", "", "t"]\n'
BAD = {
    "frame": ('frame = "lab"', "wrenches.p.frame needs one of body, world, plate; got lab"),
    "no frame": ('body = "arm"\n' + POINT, '\'point\', which takes a frame that rests: "plate" or "world"'),
    "on a body frame": ('on = "arm"', "[wrenches.p] has 'on', which takes a frame that rests"),
    "body": ('frame = "world"\nbody = "arm"', "rests in the world: the body that touches it is stated by 'on'"),
    "no body": ('frame = "world"', "wrenches.p.on needs one of pelvis"),
    "unknown body": ('frame = "world"\non = "hand"', "arm, auto; got hand"),
    "alone": ('frame = "world"\non = "auto"', 'wrenches.p.among, which on = "auto" needs, is a list of the two bodies'),
    "twice": (
        'frame = "world"\non = "auto"\namong = ["arm", "arm"]',
        "is a list of the two bodies or more that may be on it",
    ),
    "unknown among": ('frame = "world"\non = "auto"\namong = ["arm", "leg"]', "wrenches.p.among needs one of pelvis"),
    "among one": ('frame = "world"\non = "arm"\namong = ["arm", "foot_r"]', 'among belongs to on = "auto"; got on ='),
    "turned world": ('frame = "world"\non = "arm"\nrpy_deg = [0, 0, 9]', "'rpy_deg' would turn them: say frame"),
    "no pose": (ON, "[wrenches.p] needs the plate's pose in the world: 'position' with a rotation, or 'corners'"),
    "both poses": (ON + CORNERS + "position = [0, 0, 0]", "[wrenches.p] needs 'corners' or 'position', got both"),
    "origin alone": (ON + "position = [0, 0, 0]\norigin = [0, 0, 0]", "wrenches.p.origin belongs to 'corners'"),
    "three corners": (ON + "corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]", "wrenches.p.corners needs four points"),
    "flat corner": (ON + "corners = [[0, 0], [1, 0], [1, 1], [0, 1]]", "wrenches.p.corners needs a list of 3 numbers"),
    "no rectangle": (ON + "corners = [[0,0,0], [1,0,0], [1,1,0], [0,1.1,0]]", "needs the corners of a rectangle"),
    "crossed": (ON + "corners = [[0,0,0], [1,1,0], [1,0,0], [0,1,0]]", "needs the corners of a rectangle"),
    "sheared": (ON + "corners = [[0,0,0], [1,0,0], [1.3,1,0], [0.3,1,0]]", "needs the corners of a rectangle"),
    "tapered": (ON + "corners = [[1,1,0], [-1,1,0], [-1.1,-1,0], [1.1,-1,0]]", "needs the corners of a rectangle"),
    "a point": (ON + "corners = [[0,0,0], [0,0,0], [0,0,0], [0,0,0]]", "needs the corners of a rectangle"),
    "no free moment": (ON + CORNERS + 'point = ["x", "y", 0]', "[wrenches.p] has 'point' without 'free_moment'"),
    "no point": (ON + CORNERS + 'free_moment = ["", "", "t"]', "[wrenches.p] has 'free_moment' without 'point'"),
    "both moments": (ON + CORNERS + POINT + 'torque = ["d", "e", "f"]', "'torque', moments about its origin, or"),
    "half a point": (ON + CORNERS + POINT.replace('"y"', '""'), "wrenches.p.point needs three coordinates, each a col"),
    "far point": (ON + CORNERS + POINT.replace("0]", "1e9]"), "got ['x', 'y', 1000000000.0]; numbers have to be below"),
    "two coordinates": (ON + CORNERS + POINT.replace(', "y"', ""), "wrenches.p.point needs three coordinates"),
    "empty moment": (ON + CORNERS + POINT.replace('"t"', '""'), "wrenches.p.free_moment needs columns beside a point"),
    "moment of two": (ON + CORNERS + POINT.replace('"", "t"', '"t"'), "free_moment needs a list of 3 columns"),
    "point unit": (ON + CORNERS + POINT + 'point_unit = "in"', "wrenches.p.point_unit needs one of m, cm, mm; got in"),
    "position of a point": (ON.replace("plate", "world") + POINT + "position = [0, 0, 1]", "no use for 'position'"),
    "threshold": (ON + CORNERS + "threshold = -1", "wrenches.p.threshold needs a force in N, zero or more; got -1"),
    "held": ('body = "arm"\n[base]\nheld = "no"', "base.held needs true or false, got no"),
}


@pytest.mark.parametrize("name", BAD)
def test_wrong_entries_are_refused_in_one_sentence(tmp_path, name):
    entry, message = BAD[name]
    log, mapping = written(tmp_path, [({}, HEAD + entry)])
    assert message in sentence_of(ident.read_log, log, walker.mechanism(), mapping)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ('on = "arm"', "[wrenches.ground] needs no 'on': the ground acts at the base; got arm"),
        ("", "[wrenches.ground] rests in the world while the base moves: give it another name"),
    ],
)
def test_a_ground_has_no_body_and_a_base_that_moves_no_ground_in_the_world(tmp_path, entry, message):
    columns, text = plain("ground", walker.truth()[0])
    person = sim.mechanism(walker.mechanism().source.text, base="pelvis")
    log, mapping = written(tmp_path, [(columns, f'{text}frame = "world"\n{entry}\n')], walker.truth()[1]["pelvis"])
    assert message in sentence_of(ident.read_log, log, person, mapping)


FORCE = """<ExternalForce name="{name}">{more}<applied_to_body>{body}</applied_to_body>
<force_expressed_in_body>{frame}</force_expressed_in_body><point_expressed_in_body>ground</point_expressed_in_body>
<force_identifier>{name}_v</force_identifier><point_identifier>{name}_p</point_identifier>{torque}</ExternalForce>"""
TORQUE = "<torque_identifier>{}_m</torque_identifier>"
SLIDE = np.eye(6)[0]


def force(name, body, frame="ground", more="", torque=TORQUE):
    return FORCE.format(name=name, body=body, frame=frame, more=more, torque=torque.format(name))


def loads(path, *forces, tag="ExternalLoads"):
    inner = f'<{tag} name="walk"><objects>{"".join(forces)}</objects></{tag}>'
    path.write_text(f'<OpenSimDocument Version="40000">{inner}</OpenSimDocument>', encoding="utf-8")
    return path


def feet():
    """Two feet that slide along x, the right one at z = 0.1 m."""
    bodies = []
    for name, z in (("foot_r", 0.1), ("foot_l", -0.1)):
        home = np.eye(4)
        home[2, 3] = z
        bodies.append(Body(name, -1, home, SLIDE, f"{name}_x"))
    return Mechanism(Tree(tuple(bodies)), np.array([0, -9.81, 0]))


def logged(path, places):
    """A log in which a force of 100 N acts at each z, on plates called a, b and so on."""
    t = np.arange(40) / 100
    columns = {"time": t, "foot_r_x": 0 * t, "foot_l_x": 0 * t}
    for name, z in zip("ab", places, strict=False):
        values = {"v": (0, 100, 0), "p": (0.01, 0, z), "m": (0, 0.5, 0)}
        columns |= {f"{name}_{kind}{axis}": t * 0 + x for kind, xs in values.items() for axis, x in zip("xyz", xs)}  # noqa: B905
    return write_csv(path, columns)


def test_plates_are_under_the_feet_that_the_file_names(tmp_path):
    path = loads(tmp_path / "loads.xml", force("a", "/bodyset/foot_r"), force("b", "foot_l"))
    log = read_log(logged(tmp_path / "log.csv", (0.1, -0.1)), feet(), path)
    assert np.linalg.norm(log["foot_r on a_force"][0]) == pytest.approx(100)
    assert np.linalg.norm(log["foot_l on b_force"][0]) == pytest.approx(100)
    assert not log["foot_l on a_force"].any() and not any("expected" in note for note in log.notes)
    assert read_segments(path) is None


def test_forces_that_do_not_act_are_left_out(tmp_path):
    idle = force("b", "foot_l", more="<appliesForce>false</appliesForce>")
    path = loads(tmp_path / "loads.xml", force("a", "foot_r"), idle)
    assert list(external_loads(path, ("foot_r",))["wrenches"]) == ["a"]
    assert external_loads(path, ("foot_r",))["wrenches"]["a"]["on"] == "foot_r"


@pytest.mark.parametrize(
    "forces, message",
    [
        ([], "have an <ExternalForce> that acts, this <OpenSimDocument> has none"),
        ([force("a", "toes")], "\"a\"> acts on 'toes', which is no body of the model; those are foot_r, foot_l"),
        ([force("a", "foot_r", frame="foot_r")], "needs the ground as its force_expressed_in_body, got 'foot_r'"),
        ([force("a", "foot_r", torque="")], "needs a <torque_identifier>"),
        ([force("a", "foot_r"), force("a", "foot_l")], "every <ExternalForce> needs a name of its own"),
    ],
)
def test_what_cannot_be_taken_is_said(tmp_path, forces, message):
    with pytest.raises(LogError, match=rf"loads\.xml: .*{message}"):
        external_loads(loads(tmp_path / "loads.xml", *forces), ("foot_r", "foot_l"))


def test_files_that_are_none_are_refused(tmp_path):
    log = logged(tmp_path / "log.csv", ())
    with pytest.raises(LogError, match="are an XML file that exists"):
        read_log(log, feet(), tmp_path / "gone.xml")
    (tmp_path / "torn.xml").write_text("<OpenSimDocument>", encoding="utf-8")
    with pytest.raises(LogError, match=r"torn\.xml: the file needs to be XML"):
        read_log(log, feet(), tmp_path / "torn.xml")
