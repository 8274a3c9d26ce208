"""The table of set-up errors: its sentences and labels, and what other rooms take from it."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from measurements import random_measurement

from ident import Body, Equations, Mechanism, Tree
from ident.estimation.setup_parameters import SetupParameter, objects, setup_parameters
from ident.judgement.finding import Place, place_of, sentence, setup_findings
from ident.recordings.mapping import DEVIATIONS
from ident.recordings.stated import Tracker
from ident.setup import SETUP
from ident.trajectory.moves import _groups
from ident.trajectory.setup_search import Deviation


@pytest.mark.parametrize("kind", SETUP)
def test_words_of_every_kind_name_its_object_axis_size_and_sign(kind):
    row = SETUP[kind]
    each = SetupParameter(kind, "it", 1 if "{axis}" in row.label else None, std=0.1)
    size = "30.00 ± 0.10 " if row.unit.factor == 1e3 else "3.000 ± 0.010 %" if row.unit.factor == 100 else "1.7189"
    for value, sign in ((0.03, 0), (-0.03, 1)):
        text = sentence(each, value, 1e-4)
        assert size in text and row.unit.shown in text and not re.search(r"[{}]|None", text)
        assert row.signs[sign].format(axis="y") in text
        assert ("{of}" in row.sentence) == bool(re.search(r"\bit\b", text))
    for words in (row.short, row.label):
        text = each.text(words)
        assert not re.search(r"[{}]|None", text) and ("{axis}" not in words or " y" in text)


def test_a_shift_along_a_link_is_away_from_its_other_end_or_towards_it():
    start = "The joint 'knee' lies 12.3 ± 1.1 mm farther from the joint 'hip' than in the model."
    for link, value, words in (("hip", 1, "farther from"), ("hip", -1, "nearer to"), ("-hip", 1, "nearer to")):
        each = SetupParameter("centre", "knee", 2, 0.01, link=link)
        text = sentence(each, 0.0123 * value, 0.0011)
        assert text.startswith(f"{start.replace('farther from', words)} The estimate includes this. Inertias of an upd")
    each = SetupParameter("centre", "knee", 2, 0.01, link="hip")
    fit = SimpleNamespace(names=[each.name], covariance=np.eye(1) * 0.0011**2, theta=np.array([0.0123]))
    own = {"deviations": (Deviation(0, ()),), "setup": {0: each}, "std_setup": np.array([0.0011])}
    (finding,) = setup_findings(SimpleNamespace(fit=fit, **own))
    assert finding.text.startswith(start)


def test_every_kind_has_objects_and_every_parameter_a_place():
    m = random_measurement(np.random.default_rng(0), 3, ("revolute",))
    every = objects(m.equations, ["hand"], held=True, trackers={"tool": Tracker(m.tree.names[-1])})
    commanded = random_measurement(np.random.default_rng(0), 3, ("revolute",), wrench=False, contacts=0, commanded=True)
    of_commands, without_hand = objects(commanded.equations, [], held=False), objects(m.equations, [], held=True)
    assert {row.of for row in SETUP.values()} == {*every}
    assert all(every[key] or of_commands[key] or without_hand[key] for key in every)
    assert not every["torque_clocks"] and not of_commands["torque_clocks"] and without_hand["torque_clocks"]
    assert not every["commands"] and of_commands["commands"]
    assert not every["scales"] and of_commands["scales"]
    places = {each.name: place_of(each) for each in setup_parameters(m.equations, ["hand"])}
    joint = m.tree.joints[0]
    for name, place in {
        "delay(ground)": Place(wrenches=("ground",)),
        "origin_x(hand)": Place(wrenches=("hand",)),
        "gain(Fx)": Place(channels=("Fx",)),
        "gain(hand Mz)": Place(wrenches=("hand",)),
        f"zero({joint})": Place(joints=(joint,)),
    }.items():
        assert places[name] == place
    assert {place for name, place in places.items() if name.startswith("gravity")} == {Place()}
    alone = setup_parameters(m.equations, ["left", "right"], held=False)[0]
    assert place_of(alone) == Place(wrenches=("left", "right"))


def test_a_common_turn_of_all_axes_is_about_an_axis_of_the_base_frame():
    m = random_measurement(np.random.default_rng(0), 4, ("revolute",))
    groups = _groups(m.setup_at, len(m.names))
    home = m.tree.poses(np.zeros(m.tree.size))[:, :3, :3]
    for name, direction in zip("xyz", np.eye(3), strict=True):
        turned = m.corrected_tree(1e-6 * groups[f"a turn of all joint axes about {name}"])
        for R, before, after in zip(home, m.tree.bodies, turned.bodies, strict=True):
            axis, other = R @ before.twist[3:], R @ after.twist[3:]
            np.testing.assert_allclose(other - axis, 1e-6 * np.cross(direction, axis), atol=1e-11)


@pytest.mark.parametrize("left", ["l", "left", "other"])
def test_links_of_both_sides_are_longer_alike(left):
    bodies = [Body("pelvis", -1, np.eye(4), np.eye(6)[3], "root")]
    for side, y in (("r", -0.1), (left, 0.1)):
        for joint, parent, place in ((f"hip_{side}", 0, [0, y, 0]), (f"knee_{side}", len(bodies), [0, 0, -0.4])):
            home = np.eye(4)
            home[:3, 3] = place
            bodies.append(Body(f"below_{joint}", parent, home, np.eye(6)[4], joint))
    setup = setup_parameters(Equations.of_wrench(Mechanism(Tree(tuple(bodies)), np.array([0, 0, -9.81]))), ())
    shares = {name: own for name, own in _groups(dict(enumerate(setup)), len(setup)).items() if "length" in name}
    named = {name: {setup[k].name: own[k] for k in np.flatnonzero(own)} for name, own in shares.items()}
    hips, knees = (
        {"centre_y(hip_r)": -1, f"centre_y(hip_{left})": 1},
        dict.fromkeys(["centre_z(knee_r)", f"centre_z(knee_{left})"], -1),
    )
    alike = {"root to hip": hips, "hip to knee": knees} if left != "other" else {}
    assert named == {f"another length of every link from {ends}": own for ends, own in alike.items()}


def test_columns_files_and_arguments_take_every_kind():
    angles = ("rotation_deg", "gravity_deg", "zero_deg", "axis_deg")
    assert list(DEVIATIONS) == [
        "delay",
        "lag",
        "clock",
        "origin",
        "gain",
        "centre",
        "torque_delay",
        "tracker_delay",
        *angles,
    ]
    assert {key: factor for key, factor in DEVIATIONS.items() if factor != 1} == dict.fromkeys(angles, np.pi / 180)
