"""Loops against MuJoCo's constraints, by virtual work and Lagrange's multipliers; and loops that cannot be closed."""

import warnings

import numpy as np
import pytest
from looped import (
    CRANK,
    FIVE_BAR,
    FOUR_BAR,
    GRIPPER,
    MODELS,
    PARALLELOGRAM,
    ROCKER,
    body,
    by_mujoco,
    closed,
    read,
    text,
)
from mechanisms import by_joint, sines

import ident
from ident.errors import InputError, ModelError
from ident.estimation.equations import stated_drive_torques
from ident.estimation.preparation import prepared
from ident.mechanism.motion import Motion
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor, pulled_back
from ident.parameters.structure import Sensors
from sim.models.notes import ModelNote

pytestmark = pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
WRENCH = [f"ground_{letter}{x}" for letter in "fm" for x in "xyz"]


def four_bar(model=FOUR_BAR):
    return read(model).closed(("rod", "rocker"), ("crank",))


def notes_of(model, **options):
    """The mechanism of a model, and what reading it notes."""
    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always", ModelNote)
        arm = read(model, **options)
    return arm, [str(each.message) for each in notes]


def reachable(name, samples, seed=0):
    """The closed mechanism, and random states of its independent joints."""
    arm, rng = closed(name), np.random.default_rng(seed)
    drawn = arm.tree.closure.drawn(rng, samples)
    q = np.concatenate([drawn.get(joint, rng.uniform(-1, 1, (samples, 1))) for joint in arm.tree.joints], axis=1)
    return arm, (q, *rng.uniform(-2, 2, (2, *q.shape)))


@pytest.mark.parametrize("name", MODELS)
def test_closed_loops_are_mujocos(name):
    arm, states = reachable(name, 4)
    tree, gravity = arm.tree, arm.gravity
    assert tree.joints == MODELS[name][1]
    gaps, rates, torques, wrenches, accelerations = by_mujoco(name, arm, states)
    assert abs(gaps).max() < 1e-9 and abs(rates).max() < 1e-9
    own = joint_torque_regressor(tree, *states, gravity=gravity) @ arm.known + stated_drive_torques(
        arm, Motion(*states)
    )
    np.testing.assert_allclose(own, torques, atol=1e-8 * abs(torques).max())
    assert abs(accelerations).max() < 1e-5 * max(1, abs(states[2]).max())
    Y = base_wrench_regressor(tree, *states, gravity=gravity)
    np.testing.assert_allclose(Y @ arm.known, wrenches, atol=1e-8 * abs(wrenches).max())


@pytest.mark.parametrize("name", ["turned", "spatial"])
def test_derivatives_by_the_independent_coordinates_are_exact(name):
    arm, states = reachable(name, 3)
    adjoints = np.random.default_rng(1).normal(size=(3, len(arm.tree.freedoms), len(arm.known)))

    def total(*moved):
        return np.sum(joint_torque_regressor(arm.tree, *moved, gravity=arm.gravity) * adjoints, axis=(1, 2))

    derivatives = pulled_back(arm, Motion(*states), range(len(arm.known)), adjoints, torques=True)
    for kind, derivative in enumerate(derivatives):
        for k in range(derivative.shape[1]):
            step = np.zeros((3, 1, derivative.shape[1]))
            step[kind, 0, k] = 1e-6
            sides = [total(*(x + sign * dx for x, dx in zip(states, step, strict=True))) for sign in (1, -1)]
            expected = (sides[0] - sides[1]) / 2e-6
            np.testing.assert_allclose(derivative[:, k], expected, atol=1e-6 * abs(expected).max() + 1e-6)


@pytest.mark.parametrize(
    ("name", "torques"),
    [
        *((name, True) for name in ("rod on balls", "five-bar", "sums")),
        *((name, False) for name in ("spherical", "spatial", "turned", "slider", "gripper")),
    ],
)
def test_base_parameters_are_those_of_the_constrained_mechanism(name, torques):
    arm, states = reachable(name, 30, seed=3)
    base = ident.find_base_parameters(arm, sensors=Sensors(base_wrench=not torques, joint_torques=torques))
    regressor = joint_torque_regressor if torques else base_wrench_regressor
    Y = regressor(arm.tree, *states, gravity=arm.gravity).reshape(-1, len(arm.known))
    assert np.linalg.matrix_rank(Y, rtol=1e-10) == base.rank
    np.testing.assert_allclose(base.reduce(Y) @ base.regroup(arm.known), Y @ arm.known, atol=1e-8 * abs(Y).max())


@pytest.mark.parametrize("angle", [1e-10, 1e-6, 3e-4, 3e-3])
@pytest.mark.parametrize("joint", ["crank", "rod", "rocker"])
def test_axes_of_loops_that_are_nearly_parallel_count_as_parallel(joint, angle):
    arm, notes = notes_of(FOUR_BAR.replace(f'name="{joint}" axis="0', f'name="{joint}" axis="{angle}'))
    named = [each for each in notes if "nearly parallel count as parallel" in each]
    off = f"{joint} {angle:.2g} rad" if joint != "crank" else f"rod {angle:.2g} rad, rocker {angle:.2g} rad"
    assert (f"({off} off)" in named[0]) if angle > 1e-9 else not named
    exact, base = (ident.find_base_parameters(each.closed(("rod", "rocker"))) for each in (read(FOUR_BAR), arm))
    assert base.rank == exact.rank == 15 and base.gap[1] < 1e-11
    if joint != "crank":
        np.testing.assert_allclose(base.beta, exact.beta, atol=1e-9)


@pytest.mark.parametrize("joint", ["crank", "rocker"])
@pytest.mark.parametrize("angle", [6e-3, 0.01, 0.03])
def test_axes_of_loops_that_are_less_nearly_parallel_are_named(joint, angle):
    """They may leave no motion, or one out of the plane, and with it base parameters of their own."""
    _, notes = notes_of(FOUR_BAR.replace(f'name="{joint}" axis="0 1 0', f'name="{joint}" axis="0 1 {angle}'))
    (note,) = (each for each in notes if "parallel" in each)
    off = f"{joint if joint != 'crank' else 'rod'} {angle:.2g} rad"
    assert "Axes in loops that are not quite parallel are taken as drawn" in note and off in note
    assert note.endswith("Where parallel ones are meant, give them the same axis.")


@pytest.mark.parametrize(
    "tilted",
    [
        FOUR_BAR.replace('name="crank" axis', 'name="crank" ref="1" axis').replace(
            'name="rocker" axis="0', 'name="rocker" ref="0.7" axis="0.003'
        ),
        FOUR_BAR.replace('name="rod" axis="0', 'name="rod" axis="0.004').replace(
            'name="rocker" axis="0', 'name="rocker" axis="0.007'
        ),
    ],
)
def test_axes_count_as_parallel_away_from_home_and_one_by_one(tilted):
    """In a posture that is not zero, and where a third axis is near the second alone."""
    arm = read(tilted).closed(("rod", "rocker"))
    assert ident.find_base_parameters(arm).rank == 15


def test_slides_of_loops_that_are_nearly_across_axes_count_as_across():
    tilted = MODELS["slider"][0].replace('axis="1 0 0"', 'axis="1 1e-3 0"')
    arms = closed("slider"), read(tilted).closed(("rod", "piston"), ("crank",))
    exact, base = map(ident.find_base_parameters, arms)
    assert base.names == exact.names
    np.testing.assert_allclose(base.beta, exact.beta, atol=1e-9)


def test_axes_of_a_coupling_may_be_meant_as_they_are():
    """Two links that a gear couples move with any axes."""
    geared = text(CRANK + ROCKER.replace('axis="0 1 0"', 'axis="2e-3 1 0"'), '<joint joint1="rocker" joint2="crank"/>')
    assert ident.find_base_parameters(read(geared).closed(("rocker",), ("crank", "rod"))).rank == 18


def test_base_parameters_need_loops_that_close_elsewhere_as_in_the_model():
    links = CRANK + ROCKER
    for k, (name, pos) in enumerate((("rod", "0.3 1e-5 0.12"), ("rocker", "0.05 0 0.22"))):
        links = links.replace(f'<joint name="{name}"', f'<site name="end{k}" pos="{pos}"/><joint name="{name}"')
    gap = four_bar(text(links, '<connect name="pin" site1="end0" site2="end1"/>'))
    assert ident.find_base_parameters(gap).rank == ident.find_base_parameters(closed("four-bar")).rank
    with pytest.raises(ModelError, match="Loops leave crank, rod, rocker no motion"):
        ident.find_base_parameters(four_bar(FOUR_BAR.replace("<connect", "<weld")))


def test_loops_stay_on_the_branch_of_the_model():
    """Past the posture in which a parallelogram is flat, its bodies could go on as those of an antiparallelogram."""
    arm, x = four_bar(PARALLELOGRAM), np.linspace(-3, 3, 61)[:, None]
    closure = arm.tree.closure
    closes = closure.closes(x)
    assert closes[20:40].all() and not closes[:10].any() and not closes[-10:].any()
    np.testing.assert_allclose(closure.solved(x[closes]), np.hstack([-x, x])[closes], atol=1e-9)
    with pytest.raises(ModelError, match=r"The loops are singular at 1\.[67]\d* s: crank there does not determine"):
        closure.along(np.arange(0, 3, 0.2)[:, None], np.arange(0, 3, 0.2))
    # Parallel links count as one about their hinges.
    assert ident.find_base_parameters(arm, sensors=Sensors(base_wrench=False, joint_torques=True)).rank == 3


def swings(t, amplitudes, frequencies):
    """A sum of sines and its derivatives, each (N, 1)."""
    return [x[:, None] for x in sines(t, np.array(amplitudes), np.array(frequencies), 0.0)]


def assert_identified(estimate, phi):
    distance = (estimate.psi - estimate.base.regroup(phi)) / estimate.std_setup
    assert estimate.verdict().usable and abs(distance).max() < 4


def test_the_trajectory_of_a_four_bar_is_that_of_its_crank():
    arm, rng, t = closed("four-bar"), np.random.default_rng(0), np.arange(300) / 100
    states, phi = swings(t, [0.8, 0.25], [2, 5.3]), 1.2 * arm.known
    wrench, torque = (
        of(arm.tree, *states, gravity=arm.gravity) @ phi for of in (base_wrench_regressor, joint_torque_regressor)
    )
    loads = np.hstack([wrench, torque]) + 0.01 * rng.normal(size=(len(t), 7))
    log = {"time": t, "crank_position": states[0][:, 0] + 1e-3 * rng.normal(size=len(t))}
    log |= dict(zip([*WRENCH, "crank_torque"], loads.T, strict=True))
    assert_identified(ident.identify(read(FOUR_BAR), log, drive=()), phi)


def test_drives_of_dependent_joints_are_fitted_where_the_model_has_them():
    arm, t = closed("driven"), np.arange(500) / 100
    q, dq, ddq = swings(t, [1.2, 0.5, 0.2], [1.5, 4.3, 7.9])
    torque = joint_torque_regressor(arm.tree, q, dq, ddq, gravity=arm.gravity) @ arm.known
    torque += stated_drive_torques(arm, Motion(q, dq, ddq)) + 1e-4 * np.random.default_rng(0).normal(size=q.shape)
    log = {"time": t} | by_joint(["crank"], position=q, velocity=dq, acceleration=ddq, torque=torque)
    drive = ("rotor", "viscous", "spring")
    estimate = ident.identify(read(MODELS["driven"][0]), log, estimator="ordinary", drive=drive)
    for name, true in {"Fv(rod)": 0.03, "Fv(rocker)": 0.05, "K(rocker)": 0.7, "Ia(rod)": 0.002}.items():
        each = estimate[name]
        assert abs(each.value - true) < max(4 * each.std, 1e-4), (name, each)


T = np.arange(300) / 100
SWING = 0.6 * np.sin(3 * T)


def log_of(names=("crank",), q=(SWING, SWING), more=()):
    """A log of joints and of a torque on the first, and on more joints."""
    columns = {f"{name}_position": x for name, x in zip(names, q, strict=False)}
    return {"time": np.arange(len(q[0])) / 100, **columns} | {f"{name}_torque": SWING for name in (names[0], *more)}


def coupled(*equality):
    """A crank and its rod, coupled by polynomials."""
    links = {"rod": 'joint1="rod" joint2="crank"', "crank": 'joint1="crank" joint2="rod"'}
    rows = (f'<joint name="{name}" {links[of]} polycoef="{curve}"/>' for name, of, curve in equality)
    return text(CRANK, "".join(rows))


BEYOND, INFINITE = (FOUR_BAR.replace("0.3 0 0.12", anchor) for anchor in ("0.3 0 -0.08", "1e300 0 0"))
TWICE, AROUND = (coupled(("a", "rod", "0 1"), other) for other in (("b", "rod", "0 2"), ("b", "crank", "0.1 1")))
# Two that agree in the model's posture alone; and a third that agrees, of other joints or with a joint of its own.
CURVED = coupled(("a", "rod", "0 1"), ("b", "rod", "0 1 0.2"))
GEAR = '<joint name="c" joint1="flap" joint2="rocker"/>'
DIFFERENTIAL = '<tendon name="c" tendon1="both" tendon2="third"/>'
CONTRARY = "The constraints a, b contradict each other: no motion of crank, rod satisfies all of them. Leave"


# Three in a ring, and a sum of one of their joints with two of its own.
RING = "".join(
    f'<joint name="{name}" joint1="{one}" joint2="{other}" polycoef="0 {k}"/>'
    for name, one, other, k in (("a", "rod", "crank", 2), ("b", "flap", "rod", 3), ("d", "flap", "crank", 5))
)
SUM = (
    '<tendon><fixed name="both"><joint joint="crank" coef="0.6"/><joint joint="fin" coef="0.9"/></fixed>'
    '<fixed name="third"><joint joint="fan" coef="1"/></fixed></tendon>'
)
FINGERS = "".join(body(name, name, f"{x} 0 0", 0.3) for name, x in (("flap", 0.1), ("fin", -0.1), ("fan", -0.2)))
HIDDEN = text(CRANK + FINGERS, RING + '<tendon name="c" tendon1="both" tendon2="third"/>', SUM)
AT_ONCE = "The constraints a, b, d contradict each other: no motion of crank, rod, flap satisfies all of them. Leave"


def beside(third):
    """The links of sums, of which a crank and its rod are coupled by two that contradict each other, and others."""
    start, rest = MODELS["sums"][0].split("<equality>")
    two = TWICE[TWICE.index("<equality>") : TWICE.index("</equality>")]
    return f"{start}{two}{third}{rest[rest.index('</equality>') :]}".replace('"crank" coef', '"flap" coef')


STEEP, RIGID = coupled(("a", "rod", "0 1e9")), FOUR_BAR.replace("<connect", "<weld")
SKEW = FOUR_BAR.replace('name="rocker" axis="0 1 0"', 'name="rocker" axis="0.02 1 0"')
APART = text(CRANK + ROCKER.replace("<inertial", '<site name="end" pos="0 0 2"/><inertial'), "").replace(
    "<equality>", '<equality><connect name="far" site1="foot" site2="end"/>'
)
SINGULAR = r"The loops are singular at 1\.\d+ s: crank there does not determine"
TWO = "crank", "rod"


@pytest.mark.parametrize(
    ("model", "log", "message"),
    [
        (BEYOND, log_of(q=[2.5 * np.sin(T)]), r"The loops of 'pin' cannot be closed at 0\.\d+ s: .* m remain\. Check"),
        (PARALLELOGRAM, log_of(q=[1.1 * T]), SINGULAR),
        (TWICE, log_of(TWO), CONTRARY),
        (AROUND, log_of(), CONTRARY),
        *((beside(third), log_of(), CONTRARY) for third in (GEAR, DIFFERENTIAL)),
        (HIDDEN, log_of(), AT_ONCE),
        (CURVED, log_of(), CONTRARY),
        (APART, log_of(TWO), "The loops of 'far' cannot be closed in the model's posture: "),
        (FOUR_BAR, log_of(more=["rod"]), "Loops make 'rod' depend on crank: its torque or command cannot be used"),
        (
            RIGID,
            log_of(),
            "rod, rocker no motion. Align axes that are meant to be parallel, or leave a wrong constraint out",
        ),
        (INFINITE, log_of(), r"The constraint 'pin' needs numbers below 1e\+08, as of its anchor"),
        (STEEP, log_of(), r"The constraint 'a' needs numbers below 1e\+08, as of its anchor or polycoef"),
        (
            SKEW,
            log_of(),
            "Loops leave crank, rod, rocker no motion. Align axes that are meant to be parallel, or leave",
        ),
        (FIVE_BAR, log_of(), "joint 'right' needs a column of its positions|joint 'rod' needs a column"),
    ],
)
def test_loops_that_cannot_be_closed_are_one_sentence(model, log, message):
    with pytest.raises(InputError, match=message):
        ident.identify(read(model), log, estimator="ordinary")


def test_a_dependent_ball_joint_needs_no_columns_and_rests_with_the_joints_that_move_it():
    arm = read(MODELS["spatial"][0])
    moved = prepared(arm, ident.read_log(log_of(), arm), drive=()).mechanism.tree
    assert moved.dependent == ("rod.x", "rod.y", "rocker")
    still = arm.fixed({"crank": [0.2]}).tree
    for link, place in (("rocker", [0.1, 0.2, 0.3, 1]), ("rod", [0.3, 0.03, 0.12, 1])):
        ends = [tree.poses(q)[tree.names.index(link)] @ place for tree, q in ((moved, np.array([0.2])), (still, []))]
        np.testing.assert_allclose(*ends, atol=1e-9)


def test_loops_that_a_fixed_joint_holds_rest_beside_others_that_move():
    fingers = GRIPPER.replace('<joint name="same" joint1="right_driver" joint2="left_driver"/>', "")
    arm = read(fingers, fix={"left_driver": [0.1]})
    assert arm.tree.joints == ("right_driver", "right_finger", "right_link")
    assert [row.name for row in arm.constraints.rows] == ["right_pin"]


def test_joints_that_actuators_drive_through_a_tendon_are_independent():
    both = "".join(f'<joint joint="{side}_driver" coef="0.5"/>' for side in ("left", "right"))
    split = f'<tendon><fixed name="split">{both}</fixed></tendon><actuator><motor tendon="split"/></actuator>'
    arm = read(MODELS["gripper"][0].replace("<sensor>", f"{split}<sensor>"))
    assert arm.driven == ("left_driver", "right_driver") and arm.loose == ()
    assert "joints: left_driver\n" in str(arm)


def test_joints_in_loops_that_springs_alone_hold_are_named():
    """As of a Robotiq 2F-85: each side has a five-bar, of which one joint is driven."""
    sprung = FIVE_BAR.replace('name="right" axis', 'name="right" stiffness="0.05" axis')
    sprung = sprung.replace("<sensor>", '<actuator><motor joint="crank"/></actuator><sensor>')
    (arm, notes), (fixed, fewer) = notes_of(sprung), notes_of(sprung, fix=["right"])
    (note,) = (each for each in notes if "Constraints and actuators leave right free, which only springs, " in each)
    assert "--fix" in note and note not in fewer
    assert arm.loose == ("right",) == arm.closed(["rod", "arm"]).loose and fixed.loose == ()
    assert fixed.closed(["rod", "arm"]).tree.joints == ("crank",)


@pytest.mark.parametrize(
    ("solref", "soft"), [("0.02 1", False), ("0.1 1", True), ("-300 -5", True), ("-1e5 -9", False)]
)
def test_constraints_that_are_as_soft_as_springs_are_named(solref, soft):
    _, notes = notes_of(FOUR_BAR.replace('<connect name="pin"', f'<connect name="pin" solref="{solref}"'))
    assert any("Soft as a spring, but taken as rigid: pin" in each for each in notes) == soft


def test_columns_of_dependent_joints_count():
    arm, rng, t = read(FOUR_BAR), np.random.default_rng(0), np.arange(1000) / 100
    crank, closure = 0.6 * np.sin(3 * t), closed("four-bar").tree.closure
    rod, rocker = closure.solved(crank[:, None]).T
    noisy = [crank + 5e-3 * rng.normal(size=len(t)), rocker + 1e-3 * rng.normal(size=len(t)) + 0.02]
    noisy[1][7] += 0.5
    log = {"time": t, "crank_torque": np.cos(crank)}
    log |= by_joint(("crank", "rocker", "rod"), position=np.stack([*noisy, rod + 0.1 * np.sin(7 * t)], axis=1))
    ready = prepared(arm, ident.read_log(log, arm), drive=())
    assert ready.mechanism.tree.joints == ("crank",)
    slope = closure.slopes(crank[:, None], np.stack([rod, rocker], axis=1))[:, 1, 0]
    before, after = (x - crank for x in (noisy[0], ready.recording["crank_position"]))
    np.testing.assert_allclose(after.std(), np.sqrt(np.mean(1 / (5e-3**-2 + (slope / 1e-3) ** 2))), rtol=0.1)
    assert after.std() < 0.5 * before.std() and abs(after[7]) < 0.02
    assert ready.notes[-3] == "rod, rocker depend on crank, by the constraints 'pin'."
    assert "The column of 'rod' is not used: it differs from the closed loops by 0.07" in ready.notes[-2]
    assert ready.notes[-1] == "The column of 'rocker' counts too, as loops are closed, but for a constant of 0.02."
    # Backlash by 20 mrad, of which half of the samples might show nothing.
    play = rocker + 0.01 * np.sign(np.cos(3 * t)) + 1e-3 * rng.normal(size=len(t))
    log |= by_joint(("rocker", "rod"), position=np.stack([play, rod], axis=1))
    ready = prepared(arm, ident.read_log(log, arm), drive=())
    assert "The column of 'rocker' is not used" in ready.notes[-1]
    # Of joints that rest most of the time robust noise is none.
    resting = np.round(np.where(t < 6, 0.6 * np.sin(-3.0), crank), 4)
    both = closure.solved(resting[:, None])
    log |= by_joint(("crank", "rocker", "rod"), position=np.round(np.column_stack([resting, both[:, ::-1]]), 4))
    notes = prepared(arm, ident.read_log(log, arm), drive=()).notes
    assert all("counts too" in each for each in notes[-2:])
