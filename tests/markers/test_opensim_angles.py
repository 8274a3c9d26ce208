"""OpenSim models and their own markers: angles of a trial, and the command's hint for the next one."""

import numpy as np
import pytest
from commands import refusal
from opensim_walker import PLANAR, leg, motion, trial

from experiments.angles import main
from ident.files.readers import read_markers
from ident.recordings.recording import Recording
from sim.markers.marked_model import marked_model
from sim.markers.trial_fit import Kinematics


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("leg")
    trial(out, leg(out))
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
