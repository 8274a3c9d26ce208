"""A planar model and a person who sways: the finding that names channels to leave out, and its effect."""

import json
from functools import cache

import numpy as np
import pytest
import sagittal_walker
from coded import coded
from commands import refusal

import ident
from experiments import columns, identify


@cache
def estimate(leave_out=(), **options):
    return ident.identify(sagittal_walker.mechanism(), sagittal_walker.recording(**options), leave_out=leave_out)


def test_what_the_model_cannot_explain_is_named_with_the_option_that_leaves_it_out():
    (finding,) = coded(estimate(), "out_of_plane")
    assert not finding.doubt and finding.values == {"normal": "z", "channels": sagittal_walker.SIDEWAYS}
    assert finding.place.channels == sagittal_walker.SIDEWAYS and "--leave-out Fz Mx My" in finding.text
    assert set(estimate().verdict().predicted) == set(estimate().channels) - set(sagittal_walker.SIDEWAYS)


@pytest.mark.slow
def test_without_it_the_estimate_is_right_usable_and_the_same_however_she_sways():
    left_out = coded(estimate(), "out_of_plane")[0].values["channels"]
    without, upright = (estimate(left_out, sway=sway) for sway in (1.0, 0.0))
    assert without.channels == ("Fx", "Fy", "Mz") and not coded(without, "out_of_plane")
    assert without.verdict().usable and without.held_out.ratio.max() < 0.1
    z = (without.psi - without.base.regroup(sagittal_walker.mechanism().known)) / without.std
    assert len(z) == 16 and np.sqrt(np.mean(z**2)) < 1.5 and np.abs(z).max() < 4
    np.testing.assert_allclose(without.psi, upright.psi, rtol=1e-6)
    np.testing.assert_allclose(without.std, upright.std, rtol=1e-4)
    assert "Left out, as asked for: Fz, Mx, My." in without.prepared.notes


def test_signs_of_plates_are_still_held_against_the_model():
    """A plate with inverted signs is found by the remaining channels."""
    person, recording = sagittal_walker.mechanism(), sagittal_walker.recording(300)
    values = {name: -x if name in ("right_force", "right_torque") else x for name, x in recording.measured.items()}
    turned = ident.Recording(recording.time, values, sensors=recording.sensors, held=False)
    estimate = ident.identify(person, turned, leave_out=sagittal_walker.SIDEWAYS)
    (finding,) = coded(estimate, "wrench_sign_or_axes")
    assert finding.values["opposite"] and finding.values["frame"] == "as stated"
    assert finding.place.wrenches == ("right",) and not estimate.verdict().usable


def files(folder):
    """A model, and a log of angles and of two plates' forces and moments about the origin."""
    recording = sagittal_walker.recording()
    table = {"time": recording.time}
    for name, x in recording.measured.items():
        table |= {f"{name}.{axis}": x[:, k] for k, axis in enumerate("xyz")} if x.ndim == 2 else {name: x}
    np.savetxt(
        folder / "log.csv", np.column_stack(list(table.values())), delimiter=",", header=",".join(table), comments=""
    )
    (folder / "person.xml").write_text(sagittal_walker.text(), encoding="utf-8")
    mapping = "[base]\nheld = false\n"
    for name, body in sagittal_walker.STANDS.items():
        mapping += f'[wrenches.{name}]\nframe = "world"\non = "{body}"\n'
        for kind in ("force", "torque"):
            mapping += f"{kind} = {[f'{name}_{kind}.{axis}' for axis in 'xyz']}\n"
    (folder / "columns.toml").write_text(mapping, encoding="utf-8")
    return [str(folder / "person.xml"), str(folder / "log.csv")]


@pytest.mark.usefixtures("undrawn")
def test_the_option_of_the_command(tmp_path, capsys):
    given = [*files(tmp_path), "--columns", str(tmp_path / "columns.toml"), "--out", str(tmp_path)]
    message = refusal(identify.main, [*given, "--leave-out", "Fz", "sideways"], capsys)
    assert "leave_out needs a list out of Fx, Fy, Fz, Mx, My, Mz, tx, " in message and "got sideways." in message
    message = refusal(identify.main, [*given, "--leave-out", "Fx", "Fy", "Fz", "Mx", "My", "Mz"], capsys)
    assert "log.csv has nothing to fit: all that it measures is left out, Fx, Fy, Fz, Mx, My, Mz." in message


@pytest.mark.usefixtures("undrawn")
def test_columns_prints_a_command_that_can_be_copied(tmp_path, capsys):
    assert columns.main([*files(tmp_path), "--out", str(tmp_path / "guessed.toml")]) == 0
    *_, command = capsys.readouterr().out.splitlines()
    assert command.endswith(" --leave-out Fz Mx My")
    assert identify.main([*command.split()[2:], "--out", str(tmp_path), "--name", "out"]) == 0
    estimate = json.loads((tmp_path / "out" / "estimate.json").read_text(encoding="utf-8"))
    assert list(estimate["held_out"]) == ["Fx", "Fy", "Mz"] and estimate["outcome"] == "usable"
