"""Lengths of segments from markers: recovered, with right standard deviations, and written into a model."""

import mujoco
import numpy as np
import pytest
from marked import errors, labels_of, marked_person, trial

from ident.errors import InputError, ModelError
from sim.markers.lengths import grouped, scaled_model, scaling
from sim.markers.marked_model import marked_model
from sim.markers.model_files import write_scaled
from sim.markers.trial_fit import fit_trial


@pytest.fixture(scope="module")
def person():
    """A model, factors on its bodies' lengths, and marker positions of a person with these lengths."""
    spec = marked_person()
    model = spec.compile()
    groups = grouped(model)
    factors = np.random.default_rng(2).uniform(0.85, 1.15, len(groups))
    other = scaled_model(model, groups, factors)
    marked, _ = marked_model(spec, labels_of(model))
    return marked, groups, factors, other, *trial(other, 12)


def test_factors_are_recovered_and_angles_with_them(person):
    marked, groups, factors, other, _, qpos, x = person
    scaled = scaling(marked, x, groups)
    np.testing.assert_allclose(scaled.factors, factors, atol=1e-7)
    postures = fit_trial(marked.with_lengths(scaled.model), x)
    assert np.abs(errors(other, postures.qpos, qpos)).max() < 1e-5


def test_with_noise_factors_are_within_their_deviations(person):
    marked, groups, factors, _, _, _, x = person
    scaled = scaling(marked, x + 0.002 * np.random.default_rng(4).normal(size=x.shape), groups)
    z = (scaled.factors - factors) / scaled.std
    assert (z**2).sum() < 45 and scaled.std.max() < 0.03  # χ² with 18 degrees of freedom, 99.96 %.


def test_sides_and_groups_share_a_factor(person):
    model = person[0].model
    names = grouped(model, alike=True)
    assert ("left_thigh", "right_thigh") in names and ("pelvis",) in names and len(names) == 11
    assert grouped(model, [("abdomen", "thorax")])[0] == ("abdomen", "thorax")
    with pytest.raises(InputError, match="'thorax' is in two groups"):
        grouped(model, [("abdomen", "thorax"), ("thorax",)])
    with pytest.raises(ModelError, match="no body named 'tail'"):
        grouped(model, [("tail",)])


def test_lengths_that_are_no_persons_are_refused(person):
    marked, groups, *_ = person
    tall = scaled_model(marked.model, [("left_thigh", "right_thigh")], np.array([4.0]))
    *_, x = trial(tall, 3)
    with pytest.raises(InputError, match=r"of \w+_thigh would have to be scaled by more than 0\.3 to 3: check unit"):
        scaling(marked, x, groups)


def test_the_written_model_is_the_scaled_one(person, tmp_path):
    marked, groups, factors, *_ = person
    model = scaled_model(marked.model, groups, factors, mass=1.25)
    write_scaled(tmp_path / "scaled.xml", marked.spec, model)
    read = mujoco.MjModel.from_xml_path(str(tmp_path / "scaled.xml"))
    assert read.body_mass.sum() == pytest.approx(1.25 * marked.model.body_mass.sum(), rel=1e-12)
    rng, positions = np.random.default_rng(0), []
    qpos = model.qpos0.copy()
    mujoco.mj_integratePos(model, qpos, rng.normal(scale=0.4, size=model.nv), 1.0)
    for each in (model, read):
        data = mujoco.MjData(each)
        data.qpos = qpos
        mujoco.mj_forward(each, data)
        positions.append(np.vstack([data.site_xpos, data.xipos, [data.subtree_com[0]]]))
    np.testing.assert_allclose(*positions, atol=1e-9)
    np.testing.assert_allclose(read.body_inertia, model.body_inertia, rtol=1e-9)
