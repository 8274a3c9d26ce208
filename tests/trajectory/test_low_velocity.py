"""Stribeck friction is fitted for the joints for which recordings ask, and for no others."""

from dataclasses import replace

import numpy as np
import pytest
from coded import coded
from scipy.signal import savgol_filter

import ident
import scenes
from docs.tools.noise.conditions import CONDITIONS, drives
from docs.tools.noise.recordings import SUBJECTS, noisy_recording
from ident.tolerances import STRIBECK

pytestmark = pytest.mark.slow


def recorded(extra):
    """An arm that rubs, and a recording of it with friction of some joints that is higher at low velocity, N m."""
    condition = CONDITIONS["rubs_sinusoids_200"]
    arm, recording = SUBJECTS[condition.subject].mechanism, noisy_recording(condition, 0, 0)
    torques = {}
    for joint, size in extra.items():
        angle = recording.measured[f"{joint}_position"]
        rate = savgol_filter(angle, 9, 3, deriv=1, delta=1 / recording.rate)
        more = size * np.sign(rate) / (1 + (rate / STRIBECK) ** 2)
        torques[f"{joint}_torque"] = recording.measured[f"{joint}_torque"] + more
    return arm, replace(recording, measured={**recording.measured, **torques})


@pytest.mark.parametrize("extra", [{}, {"shoulder": 1.0, "wrist": 0.15}])
def test_it_is_fitted_where_recordings_ask_for_it(extra):
    arm, recording = recorded(extra)
    estimate = ident.identify(arm, recording, known=False)
    values = dict(zip(estimate.fit.names, zip(estimate.fit.values, estimate.fit.std, strict=True), strict=True))
    fitted = {name: pair for name, pair in values.items() if name.startswith("Fs(")}
    assert set(fitted) == {f"Fs({joint})" for joint in extra}
    stated = drives(arm, scenes.load("arm").compile())
    for name, true in {**{f"Fs({joint})": size for joint, size in extra.items()}, **stated}.items():
        if name.startswith(("Fs(", "Fc(")):
            value, std = values[name]
            assert abs(value - true) < 3 * std and std < 0.06 * true, name
    # Compared with least squares of the usual columns.
    assert len(estimate.filtered_values) == len(estimate.fit.names)
    assert all(estimate.filtered_values[estimate.fit.names.index(name)] == 0 for name in fitted)
    assert [set(each.place.joints) for each in coded(estimate, "low_velocity_friction")] == [set(extra)] * bool(extra)
    assert set(estimate.drives_updated) >= set(extra)
