"""Angles and lengths from markers: exact without noise, and with noise within the stated covariance."""

import mujoco
import numpy as np
import pytest
from commands import refusal, sentence_of
from marked import errors, labels_of, marked_person, trial
from opensim_walker import PLANAR, leg, motion
from opensim_walker import trial as leg_trial

from experiments.angles import main
from ident.files.readers import read_markers
from ident.recordings.recording import Recording
from sim.markers.lengths import grouped, scaled_model, scaling, write_scaled
from sim.markers.marked_model import base_of, marked_model
from sim.markers.trial_fit import Kinematics, fit_trial
from sim.markers.trial_recording import recording, swaps

FRAMES = 40


@pytest.fixture(scope="module")
def person():
    spec = marked_person()
    model = spec.compile()
    marked, unmatched = marked_model(spec, labels_of(model))
    assert not unmatched
    return marked, *trial(model, FRAMES)


def noisy(x, seed, std=0.002):
    return x + std * np.random.default_rng(seed).normal(size=x.shape)


def chi_squared(marked, postures, qpos):
    e = errors(marked.model, postures.qpos, qpos)
    return np.einsum("ni,nij,nj->n", e, np.linalg.inv(postures.covariance), e), e / postures.std


def test_angles_are_exact_without_noise_and_else_within_their_covariance(person):
    marked, _, qpos, x = person
    postures = fit_trial(marked, x[:20])
    assert np.abs(errors(marked.model, postures.qpos, qpos[:20])).max() < 1e-9
    assert postures.sigma < 1e-9 and postures.determined.all() and (postures.robust == 1).all()
    n, parts = len(marked.dofs), []
    for seed in range(3):
        postures = fit_trial(marked, noisy(x, seed))
        assert postures.sigma == pytest.approx(0.002, rel=0.04)
        parts.append(chi_squared(marked, postures, qpos))
    chi, z = map(np.concatenate, zip(*parts, strict=True))
    assert chi.mean() == pytest.approx(n, abs=5 * np.sqrt(2 * n / len(chi)))
    # Each degree of freedom by itself: free joint, balls, hinges.
    np.testing.assert_allclose((z**2).mean(axis=0), 1, atol=5 * np.sqrt(2 / len(z)))


def test_outlying_and_exchanged_markers_are_found_and_do_no_harm(person):
    marked, _, qpos, x = person
    y = noisy(x, 5)
    a, b, c = (marked.labels.index(name) for name in ("left_shank_0", "right_shank_1", "thorax_2"))
    y[:, [a, b]] = y[:, [b, a]]
    y[10:14, c] += 0.2
    postures = fit_trial(marked, y)
    outlying = np.zeros(y.shape[:2], bool)
    outlying[:, [a, b]] = outlying[10:14, c] = True
    np.testing.assert_array_equal(postures.outlying, outlying)
    (swap,) = swaps(postures, y)
    assert set(swap.labels) == {"left_shank_0", "right_shank_1"} and swap.frames == FRAMES
    assert postures.sigma == pytest.approx(0.002, rel=0.06)
    chi, _ = chi_squared(marked, postures, qpos)
    assert chi.mean() == pytest.approx(41, rel=0.15)


def test_slides_and_fixed_joints():
    spec = mujoco.MjSpec.from_string("""<mujoco><worldbody><body name="a"><joint name="s" type="slide" axis="1 0 0"/>
        <geom size=".1"/><site name="p" pos="0 0 .1"/><body name="b" pos="0 0 .3"><joint name="h" axis="0 1 0"/>
        <joint name="stuck" axis="1 0 0"/><geom size=".1"/><site name="q" pos=".1 .05 .2"/></body></body>
        </worldbody></mujoco>""")
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos = [0.2, 0.5, 0.3]
    mujoco.mj_kinematics(model, data)
    marked, _ = marked_model(spec, ["p", "q"], fix={"stuck": [0.3]})
    postures = fit_trial(marked, np.array([data.site_xpos]))
    np.testing.assert_allclose(postures.qpos, [[0.2, 0.5, 0.3]], atol=1e-9)
    assert marked.dof_names == ["s", "h"]


@pytest.fixture(scope="module")
def scaled_person():
    """A model, factors on its bodies' lengths, and marker positions of a person with these lengths."""
    spec = marked_person()
    model = spec.compile()
    groups = grouped(model)
    factors = np.random.default_rng(2).uniform(0.85, 1.15, len(groups))
    other = scaled_model(model, groups, factors)
    marked, _ = marked_model(spec, labels_of(model))
    return marked, groups, factors, other, *trial(other, 12)


def test_factors_are_recovered_and_angles_with_them_and_with_noise_within_their_deviations(scaled_person):
    marked, groups, factors, other, _, qpos, x = scaled_person
    scaled = scaling(marked, x, groups)
    np.testing.assert_allclose(scaled.factors, factors, atol=1e-7)
    postures = fit_trial(marked.with_lengths(scaled.model), x)
    assert np.abs(errors(other, postures.qpos, qpos)).max() < 1e-5
    scaled = scaling(marked, noisy(x, 4), groups)
    z = (scaled.factors - factors) / scaled.std
    assert (z**2).sum() < 45 and scaled.std.max() < 0.03  # χ² with 18 degrees of freedom, 99.96 %.


def test_sides_and_groups_share_a_factor_which_is_a_persons(scaled_person):
    marked, groups, *_ = scaled_person
    names = grouped(marked.model, alike=True)
    assert ("left_thigh", "right_thigh") in names and ("pelvis",) in names and len(names) == 11
    assert grouped(marked.model, [("abdomen", "thorax")])[0] == ("abdomen", "thorax")
    tall = scaled_model(marked.model, [("left_thigh", "right_thigh")], np.array([4.0]))
    for call, *given, message in (
        (grouped, marked.model, [("abdomen", "thorax"), ("thorax",)], "'thorax' is in two groups"),
        (grouped, marked.model, [("tail",)], "no body named 'tail'"),
        (
            scaling,
            marked,
            trial(tall, 3)[2],
            groups,
            "_thigh would have to be scaled by a factor above 3, up or down: check",
        ),
    ):
        assert message in sentence_of(call, *given)


def test_the_written_model_is_the_scaled_one(scaled_person, tmp_path):
    marked, groups, factors, *_ = scaled_person
    model = scaled_model(marked.model, groups, factors, mass=1.25)
    write_scaled(tmp_path / "scaled.xml", marked.spec, model)
    read = mujoco.MjModel.from_xml_path(str(tmp_path / "scaled.xml"))
    assert read.body_mass.sum() == pytest.approx(1.25 * marked.model.body_mass.sum(), rel=1e-12)
    np.testing.assert_allclose(trial(read, 3)[2], trial(model, 3)[2], atol=1e-9)
    for field in ("body_mass", "body_ipos", "body_inertia"):
        np.testing.assert_allclose(getattr(read, field), getattr(model, field), rtol=1e-9, atol=1e-12)


def test_frames_without_markers_and_joints_without_any(person):
    marked, *trial = person
    time, qpos, y = (each[:30].copy() for each in trial)
    y[10:13] = np.nan
    y[:, [k for k, label in enumerate(marked.labels) if label.startswith(("left_hand", "left_toes"))]] = np.nan
    base = base_of(marked.model, None)
    angles = recording(fit_trial(marked, y), time, base)
    assert base == "pelvis" and angles.base.shape == (30, 4, 4)
    assert not {"left_toes_position", "left_wrist_flexion_position"} & angles.measured.keys()
    assert "The markers do not determine joint 'left_toes', which has no channel." in angles.notes
    for what in ("Joint 'left_knee'", "The base"):
        assert f"{what} is interpolated in 3 frames that do not determine it." in angles.notes
    knee = qpos[:, marked.model.joint("left_knee").qposadr[0]]
    there = np.delete(np.arange(30), [10, 11, 12])
    np.testing.assert_allclose(angles["left_knee_position"][there], knee[there], atol=1e-9)
    np.testing.assert_allclose(angles["left_knee_position"][10:13], np.interp([1, 2, 3], [0, 4], knee[[9, 13]]))
    np.testing.assert_allclose(angles.base[there, :3, 3], qpos[there, :3], atol=1e-9)
    assert np.isnan(angles.as_measured("left_knee_position").values).sum() == 3
    assert 0 <= angles.noise["left_knee_position"] < 1e-8


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("leg")
    leg_trial(out, leg(out))
    return out


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_markers_are_where_the_tree_has_them_and_followers_are_in_the_jacobian(folder):
    marked, unmatched = marked_model(folder / "leg.osim", read_markers(folder / "walk.trc").labels)
    assert not unmatched and marked.up == "y" and marked.dof_names == list(PLANAR)
    kinematics, rng = Kinematics(marked), np.random.default_rng(0)
    qpos = kinematics.moved(marked.rest, rng.uniform(-0.4, 0.1, len(marked.dofs)))
    kinematics.positions(qpos)
    J = kinematics.jacobian().copy()
    for d, step in enumerate(1e-6 * np.eye(len(marked.dofs))):
        ends = [kinematics.positions(kinematics.moved(qpos, sign * step)).copy() for sign in (1, -1)]
        np.testing.assert_allclose(J[:, :, d], (ends[0] - ends[1]) / 2e-6, atol=1e-8)


@pytest.mark.usefixtures("undrawn")
def test_angles_of_an_opensim_model_and_the_command_that_comes_next(folder, tmp_path, capsys):
    given = [str(folder / "leg.osim"), str(folder / "walk.trc"), "--out", str(tmp_path / "out")]
    assert main(given) == 0
    recording = Recording.load(tmp_path / "out" / "angles.npz")
    for k, name in enumerate(PLANAR):
        z = (recording[f"{name}_position"] - motion()[1][:, k]) / recording.noise[f"{name}_position"]
        assert np.sqrt(np.mean(z**2)) < 1.3
    output = capsys.readouterr().out
    assert f"multicontact identify {folder / 'leg.osim'} {tmp_path / 'out' / 'angles.csv'}+PLATES" in output
    assert "+PLATES.mot --leave-out Fz Mx My\n" in output
    message = refusal(main, [*given, "--scale"], capsys)
    assert "--scale needs an MJCF or URDF model; let OpenSim's Scale Tool" in message
