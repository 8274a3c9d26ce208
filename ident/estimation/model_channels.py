"""Channels as a model predicts them, with its bodies and drives."""

from typing import Any

import numpy as np

from ident.estimation.equations import COMPONENTS
from ident.estimation.stated_drives import stated_drive_torques
from ident.geometry.se3 import coAd, inverse
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model.regressor import CHUNK, base_wrench_regressor, joint_torque_regressor


def predicted_channels(
    mechanism: Mechanism, motion: Motion, frame: np.ndarray, *, torques: bool = False
) -> dict[str, np.ndarray]:
    """Components of the total wrench in a frame, and joint torques if requested, as the model predicts them (N,) each.

    It predicts with its prior and with the drives that it states.
    """
    in_frame = coAd(inverse(frame))
    wrenches, felt = [], []
    for first in range(0, len(motion), CHUNK):
        part = motion[first : first + CHUNK]
        given: dict[str, Any] = {"gravity": mechanism.gravity, "base": part.base}
        Y = base_wrench_regressor(mechanism.tree, *part.states, **given)
        wrenches.append(Y @ mechanism.known @ in_frame.T)
        if torques:
            links = joint_torque_regressor(mechanism.tree, *part.states, **given) @ mechanism.known
            felt.append(links + stated_drive_torques(mechanism, part) if mechanism.drives else links)
    predicted = dict(zip(COMPONENTS, np.concatenate(wrenches).T, strict=True))
    return predicted | (dict(zip(mechanism.tree.freedoms, np.concatenate(felt).T, strict=True)) if torques else {})
