"""Forces and lengths that a model lacks: doubted by what they would predict better."""

import numpy as np
import pytest
from coded import coded
from recorded_faults import JOINTS, PENDULUM, estimated, faulty, with_torques

import ident
import scenes
import sim
from ident.estimation.equations import Equations
from ident.estimation.samples import Samples
from ident.judgement.unmodelled import HypothesisFit, unmodelled
from ident.mechanism.motion import Motion


def shorter(share):
    """The pendulum with its second joint nearer to the first."""
    spec = scenes.load("double_pendulum")
    spec.body("link2").pos = share * np.array(spec.body("link2").pos)
    return sim.mechanism(spec, base="base")


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "wrench"), [(1, False)])
def test_a_cable_that_pulls_is_a_doubt(seed, wrench):
    estimate = ident.identify(PENDULUM, with_torques(seed, pull=10, wrench=wrench), setup={"centre": 0.0})
    (finding,) = coded(estimate, "unmodelled")
    assert finding.doubt and finding.values["causes"][0] == {"kind": "force", "body": "link2"}
    assert finding.place.bodies[0] == "link2" and finding.values["ratio"] < 0.8


@pytest.mark.slow
@pytest.mark.parametrize(("share", "seed"), [(1 / 1.15, 1)])
def test_a_link_of_another_length_is_a_doubt(share, seed):
    """Its cause is named if joints lie as stated, also where other errors of the set-up were found in its place."""
    estimate = ident.identify(shorter(share), faulty(seed), setup={"centre": 0.0})
    (finding,) = coded(estimate, "unmodelled")
    assert finding.doubt and {"kind": "length", "body": "link2"} in finding.values["causes"]


def test_errors_of_the_set_up_are_none():
    assert not coded(estimated(3, delay=0.03, origin=(0, 0.05, 0)), "unmodelled")


def compared(mechanism, wrench):
    """Hypotheses on exact samples of two random motions."""
    equations = Equations.of_wrench(mechanism)
    values = equations.parameters.regroup(mechanism.known)
    rng = np.random.default_rng(0)
    motions = [Motion(*rng.normal(size=(3, 200, len(JOINTS)))) for _ in range(2)]
    noise = 1e-3 * rng.normal(size=(2, 200, 6))
    fitted, judged = (Samples(m, wrench(m) + e) for m, e in zip(motions, noise, strict=True))
    prior = np.zeros((len(values), len(values)))
    counting = np.ones((200, 6), bool)
    return unmodelled([HypothesisFit(equations, values, prior, fitted, counting, judged)])


def test_a_length_and_a_force_are_found_exactly():
    def by(mechanism, motion):
        return ident.base_wrench_regressor(mechanism.tree, *motion.states, gravity=mechanism.gravity) @ mechanism.known

    def pulled(motion):
        pose = PENDULUM.tree.poses(motion.q)[:, PENDULUM.tree.names.index("link2")]
        at = pose[:, :3, 3] + pose[:, :3, :3] @ [0.1, 0, 0.2]
        force = 5.0 * ([1.0, 2.0, 3.0] - at)
        return by(PENDULUM, motion) - np.hstack([force, np.cross(at, force)])

    right = compared(PENDULUM, lambda motion: by(PENDULUM, motion))
    assert {(each.kind, each.body) for each in right} == {("length", "link2"), ("force", "link1"), ("force", "link2")}
    assert all(0.9 < each.ratio < 1.1 for each in right)
    longer, force = compared(shorter(1 / 1.15), lambda motion: by(PENDULUM, motion)), compared(PENDULUM, pulled)
    assert (longer[0].kind, longer[0].body) == ("length", "link2") and longer[0].ratio < 0.3
    assert (force[0].kind, force[0].body) == ("force", "link2") and force[0].ratio < 1e-2
