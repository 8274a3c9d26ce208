"""OpenSim's ExternalLoads in place of a columns file."""

import numpy as np
import pytest

from ident.errors import LogError
from ident.mechanism.body import Body
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.recordings.columns.entries import read_segments
from ident.recordings.columns.plates import external_loads
from ident.recordings.log import read_log

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


def walker():
    """Two feet that slide along x, the right one at z = 0.1 m."""
    feet = []
    for name, z in (("foot_r", 0.1), ("foot_l", -0.1)):
        home = np.eye(4)
        home[2, 3] = z
        feet.append(Body(name, -1, home, SLIDE, f"{name}_x"))
    return Mechanism(Tree(tuple(feet)), np.array([0, -9.81, 0]))


def written(path, places):
    """A log in which a force of 100 N acts at each z, on plates called a, b and so on."""
    t = np.arange(40) / 100
    columns = {"time": t, "foot_r_x": 0 * t, "foot_l_x": 0 * t}
    for name, z in zip("ab", places, strict=False):
        values = {"v": (0, 100, 0), "p": (0.01, 0, z), "m": (0, 0.5, 0)}
        columns |= {f"{name}_{kind}{axis}": t * 0 + x for kind, xs in values.items() for axis, x in zip("xyz", xs)}  # noqa: B905
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    return path


def test_plates_are_under_the_feet_that_the_file_names(tmp_path):
    path = loads(tmp_path / "loads.xml", force("a", "/bodyset/foot_r"), force("b", "foot_l"))
    log = read_log(written(tmp_path / "log.csv", (0.1, -0.1)), walker(), path)
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
    log = written(tmp_path / "log.csv", ())
    with pytest.raises(LogError, match="are an XML file that exists"):
        read_log(log, walker(), tmp_path / "gone.xml")
    (tmp_path / "torn.xml").write_text("<OpenSimDocument>", encoding="utf-8")
    with pytest.raises(LogError, match=r"torn\.xml: the file needs to be XML"):
        read_log(log, walker(), tmp_path / "torn.xml")
