"""Judges of residuals, convergence, set-up, contacts, mass, parts of the data, and of what a model lacks."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from coded import coded
from recorded_faults import JOINTS, PENDULUM, TRUTH, angles_and_wrench, estimated, faulty, with_torques, wrench_of

import ident
import scenes
import sim
from ident import Equations, Motion, Samples, Sensor
from ident.judgement import mass_findings, payload_findings
from ident.judgement.checks import ContactCheck, Weight
from ident.judgement.finding import SetupFinding
from ident.judgement.fit_findings import course_findings, halves_findings, prior_findings, quality_findings
from ident.judgement.recording_findings import contact_findings, setup_remarks
from ident.judgement.residuals import LEAST_ADDED, differences, disagreements, widening, widenings
from ident.judgement.unmodelled import HypothesisFit, unmodelled
from ident.parameters.prior import KNOWN, known_covariance


def of_checks(**checks):
    return SimpleNamespace(checks=SimpleNamespace(**checks))


def test_an_estimate_that_did_not_settle_is_a_doubt():
    for status, steps, doubted in (
        ("converged", [5.0, 0.01], False),
        ("converged", [5.0, 0.5], False),
        ("rounds", [5.0, 0.25], False),
        ("rounds", [5.0, 0.35], True),
        ("stuck", [0.35], True),
        ("interrupted", [5.0, 1.0, 0.01], True),
    ):
        fit = SimpleNamespace(status=status, trace=steps)
        findings = list(course_findings(SimpleNamespace(trajectory=SimpleNamespace(fit=fit))))
        expected = [("not_converged", True, {"status": status, "rounds": len(steps)})]
        assert [(each.code, each.doubt, each.values) for each in findings] == expected * doubted


LATE = {"of": "ground", "axis": None, "value": 0.02, "std": 0.001}


def test_a_set_up_that_explains_nothing_is_a_doubt_beside_what_was_found():
    delay = SetupFinding("delay(ground)", 0.02, 0.001, "delay", LATE, ())
    for setup in ((), (delay,)):
        search = SimpleNamespace(incredible=True)
        *remarks, doubt = setup_remarks(SimpleNamespace(setup=setup, trajectory=SimpleNamespace(search=search)))
        assert [(finding.code, finding.doubt) for finding in remarks] == [("setup_delay", False)] * len(setup)
        assert (doubt.code, doubt.doubt, doubt.values) == ("setup_unexplained", True, {"changed": bool(setup)})


def test_residuals_over_signals_are_sorted_by_what_they_mean():
    ratios = {"a": 0.2, "b": 0.6, "c": 0.97, "d": 1.7, "e": 0.61}
    frames = {"ground": SimpleNamespace(mirrored=("f",))}
    given = {"ratios": ratios | {"f": 2.0, "g": 2.0}, "checks": SimpleNamespace(frames=frames), "idle": {"g": "noise"}}
    findings = list(quality_findings(SimpleNamespace(held_out=SimpleNamespace(part="held-out"), **given)))
    assert [(finding.code, finding.doubt, finding.place.channels) for finding in findings] == [
        ("residual_above_signal", True, ("d",)),
        ("unexplained_channels", False, ("c",)),
        ("poor_prediction", False, ("b", "e")),
    ]
    assert findings[2].values == {"ratios": {"b": 0.6, "e": 0.61}, "part": "held-out"}


def test_a_contact_left_out_is_on_a_body_and_is_not_measured():
    samples = SimpleNamespace(motion=Motion(*np.zeros((3, 4, 2))))
    for measured_on, distance, doubted in (("link1", 0.2, True), ("link2", 0.2, False), ("link1", 2.3, False)):
        evidence = of_checks(contact=ContactCheck("link2", np.array([0, 0, distance]), 0.8, 0.0))
        # Channels in which noise alone is left show no contact.
        evidence.idle, evidence.mechanism = dict.fromkeys(range(4), "noise"), PENDULUM
        evidence.ratios = dict.fromkeys(range(4), 0.2) | dict.fromkeys(range(4, 7), 0.5)
        recording = SimpleNamespace(sensors={"tip": Sensor(measured_on)})
        evidence.prepared = SimpleNamespace(recording=recording, samples=samples)
        assert [finding.doubt for finding in contact_findings(evidence)] == [True] * doubted


def test_the_mass_that_is_weighed_and_estimated_alike_is_told_once(monkeypatch):
    for value, measured, codes in (
        (56.0, 56.5, {"mass_or_common_gain": False}),
        (56.0, 53.0, {"weight_differs": False, "mass_or_common_gain": False}),
        (51.0, 56.5, {"weight_differs": False}),
        (70.0, 70.0, {"weight_differs": True, "mass_or_common_gain": False}),
    ):
        mass = mass_findings.Mass(value, 0.1, 0.2)
        monkeypatch.setattr(mass_findings, "estimated_mass", lambda evidence, mass=mass: mass)
        evidence = of_checks(weight=Weight(measured, 50, 0))
        evidence.setup = ()
        assert {each.code: each.doubt for each in mass_findings.weight_findings(evidence)} == codes


def test_the_weight_may_not_drift_either_way(monkeypatch):
    monkeypatch.setattr(mass_findings, "estimated_mass", lambda evidence: None)
    for drift in (0.015, 0.025, -0.015, -0.025):
        findings = list(mass_findings.weight_findings(of_checks(weight=Weight(50, 50, 50 * drift))))
        assert [finding.doubt for finding in findings] == [True] * (abs(drift) > 0.02)
        assert all(each.code == "weight_drifts" and each.values == {"drift": 50 * drift} for each in findings)


def test_a_drifting_sensor_is_weighed():
    """By so much of the model's mass over the recording, part of which is fitted."""
    right = faulty()
    wrench = wrench_of(right)
    wrench[:, 2] -= 0.1 * PENDULUM.mass * 9.81 * (right.time - right.time.mean()) / np.ptp(right.time)
    recording = angles_and_wrench(right.time, right.of_joints(JOINTS, "position"), wrench)
    estimate = ident.identify(PENDULUM, recording, estimator="weighted", cutoff=8.0)
    weight, part = estimate.checks.weight, estimate.prepared.recording.time[estimate.prepared.taken(estimate.part)]
    assert weight.drift / PENDULUM.mass == pytest.approx(-0.1 * np.ptp(part) / np.ptp(right.time), abs=0.01)
    assert weight.measured == pytest.approx(PENDULUM.mass, rel=0.02) and weight.model == PENDULUM.mass


def test_it_is_a_doubt_where_the_wrenches_and_the_model_agree():
    """The model is as wrong as the channel."""
    model = replace(PENDULUM, prior=1.1 * PENDULUM.known)
    (finding,) = coded(ident.identify(model, faulty(gains=(1, 1, 1.1, 1, 1, 1))), "mass_by_setup")
    assert finding.doubt


def test_a_gain_of_all_channels_is_one_with_the_mass():
    estimate = estimated(gains=(1.08,) * 6)
    (finding,) = coded(estimate, "mass_or_common_gain")
    assert not finding.doubt and finding.values["mass"] == pytest.approx(22.67, abs=0.005)
    assert finding.values["mass"] / finding.values["model"] == pytest.approx(1.08, abs=0.0005)
    assert abs(estimate.psi[0] - 1.08 * TRUTH[0]) < 0.1
    mass = mass_findings.estimated_mass(estimate)
    assert (mass.value, mass.std, mass.std_setup) == (estimate.psi[0], estimate.std[0], estimate.std_setup[0])
    assert (np.abs(estimate.psi - TRUTH) < 3 * estimate.std_setup).all()


@pytest.fixture
def of_payload(monkeypatch):
    """Findings on a payload, without those on the fit."""
    monkeypatch.setattr(payload_findings, "JUDGES", ())
    for name in ("force_findings", "consistency_findings"):
        monkeypatch.setattr(payload_findings, name, lambda evidence: ())
    return partial(payload_findings.payload_findings, None)


def test_a_payload_is_hardly_heavier_than_its_robot_and_never_than_any_robot_carries(of_payload):
    remarks, doubts = ((21, 20),), ((210, 20), (2400, None), (2400, 4000))
    for mass, robot in ((19, 20), (2200, None), (2200, 4000), *remarks, *doubts):
        findings = of_payload(mass, robot, np.ones(10, bool), "wrist")
        expected = [("payload_mass_unlikely", (mass, robot) in doubts, {"mass": mass, "robot": robot})]
        named = [(each.code, each.doubt, each.values) for each in findings]
        assert named == expected * ((mass, robot) in {*remarks, *doubts})


def test_a_rough_axis_of_a_payload_is_a_remark_and_only_an_open_mass_a_doubt(of_payload):
    known, axis = np.arange(10) % 4 > 0, np.array([0, 0, 1.0])
    for std, rough in ((0.09, []), (0.11, [("payload_axis_rough", False)])):
        findings = of_payload(1.0, None, known, "wrist", (axis, std, 0.5))
        unknown = [("payload_mass_unknown", True), ("payload_inertia_unknown", False)]
        assert [(each.code, each.doubt) for each in findings] == unknown + rough


def shorter(share):
    """The pendulum with its second joint nearer to the first."""
    spec = scenes.load("double_pendulum")
    spec.body("link2").pos = share * np.array(spec.body("link2").pos)
    return sim.mechanism(spec, base="base")


@pytest.mark.slow
def test_a_cable_that_pulls_is_a_doubt():
    estimate = ident.identify(PENDULUM, with_torques(1, pull=10, wrench=False), setup={"centre": 0.0})
    (finding,) = coded(estimate, "unmodelled")
    assert finding.doubt and finding.values["causes"][0] == {"kind": "force", "body": "link2"}
    assert finding.place.bodies[0] == "link2" and finding.values["ratio"] < 0.8


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


def test_what_adds_nothing_does_not_differ_by_rounding():
    """A recording counts as adding at least a hundredth of the variance; estimates of one parameter by three."""
    estimates, precision = np.array([1.0, 1.1, 0.9]), np.array([10.0, 20, 1e-9])
    theta, whole = np.average(estimates, weights=precision), precision.sum()
    each = lambda x: np.array([[x]])  # noqa: E731
    fit = SimpleNamespace(
        theta=np.array([theta]),
        gradient=np.zeros(1),
        free=np.array([True]),
        counted=np.array([True]),
        bounded=None,
        noises=[SimpleNamespace(channels=np.ones(1))] * 3,
        shares=[(each(P), np.array([P * (x - theta)])) for P, x in zip(precision, estimates, strict=True)],
        scatter_shares=[each(P) for P in precision],
        prior=SimpleNamespace(precision=each(0.0), mean=np.zeros(1), weight=1.0),
        precision=each(whole),
        scatter=each(whole),
        covariance=each(1 / whole),
    )
    equations = SimpleNamespace(parameters=SimpleNamespace(rank=1))
    measurement, pieces = SimpleNamespace(equations=equations), lambda k: slice(k, k + 1)
    result = SimpleNamespace(fit=fit, counts=(1, 1, 1), measurement=measurement, pieces_of=pieces)
    moved = abs(np.average(estimates[:2], weights=precision[:2]) - theta)
    assert disagreements(result)[2] == pytest.approx(moved / np.sqrt(LEAST_ADDED / whole))
    assert LEAST_ADDED < 0.02
    # The pieces of one recording by halves, of which either has to determine the parameter.
    result.counts = (3,)
    assert differences(result) == pytest.approx([-0.1 / np.sqrt(1 / 10 + 1 / 20)])
    fit.shares[0] = each(0.0), np.zeros(1)
    assert differences(result) is None


def disagreeing(between=(), halves=None, logs=(), widened=None):
    """Findings on the disagreement of recordings, of halves, of own parameters, and on ratios in each log."""
    of_logs = {"disagreements": between, "in_logs": logs, "channels": ("Fx", "Fy")}
    result = SimpleNamespace(disagreement=halves, widened=widened, **of_logs)
    return [(each.code, each.doubt, each.values) for each in halves_findings(result)]


def test_recordings_and_halves_disagree_from_two_deviations_and_recordings_are_a_doubt_from_four():
    for z, doubt in ((2.2, False), (3.8, False), (4.2, True)):
        values = {"logs": (2,), "rms_z": (z,), "best": ()}
        assert disagreeing((0.5, z, 0.7)) == [("logs_disagree", doubt, values)]
    assert disagreeing(halves=2.3) == [("halves_disagree", False, {"rms_z": 2.3})]
    assert disagreeing(halves=1.9, widened={"m1ry1": 9.7}) == [
        ("parameter_widened", False, {"factors": {"m1ry1": 9.7}})
    ]
    assert not disagreeing((0.5, 1.8, 0.7)) and not disagreeing(halves=1.9)


def test_a_log_that_is_predicted_far_worse_than_others_is_a_doubt_however_bad_candidates_are():
    usual = {"estimate": np.array([0.2, 0.2]), "least squares": np.array([0.4, 0.2])}
    for own, doubt in ((0.35, False), (0.45, True)):
        worse = {"estimate": np.array([own, 0.2]), "least squares": np.array([1.0, 0.2])}
        ((_, doubted, values),) = disagreeing((0.5, 5.0, 0.5, 0.5), logs=[usual, worse, usual, usual])
        assert doubted is doubt and values["best"] == (() if doubt else (2,))


def test_widened_intervals_hold_where_the_noise_is_more_than_stated():
    """Errors and 12 differences have `excess` times the stated variance; without widening .95 .89 .78 .67 hold."""
    for excess, low, high in ((1, 0.955, 0.965), (1.5, 0.93, 0.95), (2.5, 0.92, 0.95), (4, 0.92, 0.95)):
        rng = np.random.default_rng(0)
        errors = np.sqrt(excess) * rng.normal(size=20_000)
        z = np.sqrt(excess * rng.chisquare(12, size=20_000) / 12)
        covered = np.mean(np.abs(errors) < 1.96 * np.array([widening(each) for each in z]))
        assert low < covered < high


def test_a_parameter_is_widened_by_its_own_halves_beyond_chance_alone():
    """Of 13 parameters chance makes one in a thousand recordings differ by 3.95."""
    z = np.r_[3.9, -4.0, np.zeros(11)]
    np.testing.assert_array_equal(widenings(z, 1.5, 15), np.r_[1.5, 4.0, np.full(13, 1.5)])
    np.testing.assert_array_equal(widenings(z, 5.0, 15), np.full(15, 5.0))
    np.testing.assert_array_equal(widenings(None, 1.0, 2), [1.0, 1.0])


def test_halves_that_disagree_make_no_prior_needed():
    base = ident.find_base_parameters(PENDULUM.tree, gravity=PENDULUM.gravity)
    fit = SimpleNamespace(parameters=base, equations=SimpleNamespace(absorbed={}))
    wider = np.r_[10.0, np.full(base.rank - 1, 2.0)]
    for share, code in ((0.1, "prior_beside_data"), (0.9995, "prior_needed")):
        noise = share * known_covariance(PENDULUM, base, KNOWN)
        joint = SimpleNamespace(known=True, fit=SimpleNamespace(covariance=noise))
        widened = {"covariance": np.outer(wider, wider) * noise, "widening": 2.0, "condition_number": 10.0}
        evidence = SimpleNamespace(mechanism=PENDULUM, known=KNOWN, fit=fit, trajectory=joint, **widened)
        assert [each.code for each in prior_findings(evidence)] == [code]
