"""Bodies of an estimate in written models: comments beside them, short numbers, folders that may be moved."""

import re

import numpy as np
import opensim_files
import pytest
from mechanisms import random_phi
from test_model_update import MJCF
from test_urdf_update import ARM

from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.consistency import consistent_parameters
from sim.models.model_mechanism import mechanism
from sim.models.model_update import write_model

COMMENT = re.compile(r"<!-- 95 % intervals.*?-->", re.DOTALL)
NUMBER = re.compile(r"\d\.?\d*(?:e-?\d+)?")


def full_of(arm, seed=0):
    """Bodies of a mechanism with intervals."""
    phi = random_phi(np.random.default_rng(seed), len(arm.bodies))
    base = find_base_parameters(arm)
    psi = base.regroup(phi)
    return consistent_parameters(psi, np.diag((0.01 * abs(psi) + 1e-3) ** 2), base, phi, bodies=arm.bodies)


def assert_short(text):
    """Comments apart, every number of an inertial has seven digits at most."""
    inertials = re.findall(r"<inertial>.*?</inertial>|<inertial .*?>", COMMENT.sub("", text), re.DOTALL)
    assert inertials
    for word in NUMBER.findall(" ".join(re.sub(r"<origin rpy[^x]*", "", each) for each in inertials)):
        assert len(word.partition("e")[0].replace(".", "").lstrip("0")) <= 7, word


@pytest.mark.parametrize(("text", "name"), [(MJCF.format(compiler=""), "arm.xml"), (ARM, "arm.urdf")])
@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_bodies_are_written_with_their_intervals_and_short_numbers(tmp_path, text, name):
    path, out, again = (tmp_path / each for each in (name, f"new_{name}", f"again_{name}"))
    path.write_text(text, encoding="utf-8", newline="")
    base = "base" if name == "arm.xml" else "root"
    arm = mechanism(path, base)
    full = full_of(arm)
    write_model(out, arm, full)
    first = out.read_text(encoding="utf-8")
    assert len(COMMENT.findall(first)) == len(arm.bodies) and first.isascii() == text.isascii()
    for body, row in zip(arm.bodies, full.rows[::10], strict=True):
        assert f"mass {row.words} kg" in full.comments[body] and full.comments[body] in first
    assert_short(first)
    written = mechanism(out, base)
    for ours, theirs in zip(written.known.reshape(-1, 10), full.phi.reshape(-1, 10), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-5 * abs(theirs).max())
    other = full_of(written, seed=1)
    write_model(again, written, other)
    second = again.read_text(encoding="utf-8")
    assert len(COMMENT.findall(second)) == len(arm.bodies) and other.comments[arm.bodies[-1]] in second
    write_model(out, arm, full.phi)
    assert not COMMENT.search(out.read_text(encoding="utf-8"))
    np.testing.assert_allclose(mechanism(out, base).known, full.phi, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("version", [3, 4])
def test_an_opensim_file_has_the_intervals_of_its_bodies(tmp_path, version):
    path, out = tmp_path / "model.osim", tmp_path / "new.osim"
    phi = random_phi(np.random.default_rng(2), 2)
    joints = [
        opensim_files.Joint("PinJoint", f"pin{k}", parent, f"b{k}", [opensim_files.coordinate(f"q{k}")])
        for k, parent in enumerate(("ground", "b0"))
    ]
    path.write_text(
        opensim_files.document(joints, {f"b{k}": phi[10 * k : 10 * k + 10] for k in range(2)}, version=version)
    )
    arm = mechanism(path, "b0")
    write_model(out, arm, full_of(arm))
    assert len(COMMENT.findall(out.read_text())) == len(arm.bodies)
    np.testing.assert_allclose(mechanism(out, "b0").known, full_of(arm).phi, rtol=1e-4, atol=1e-4)
