"""Positions of a model's markers and their derivatives by its degrees of freedom, by MuJoCo."""

import mujoco
import numpy as np

from sim.markers.marked_model import MarkedModel


class Kinematics:
    """Positions and Jacobians of the markers of a model, one posture at a time, in preallocated memory."""

    def __init__(self, marked: MarkedModel) -> None:
        self._model, self._data = marked.model, mujoco.MjData(marked.model)
        self._sites, self._dofs, self._followers = marked.sites, marked.dofs, marked.followers
        self._all = np.zeros((len(marked.sites), 3, marked.model.nv))
        self._step = np.zeros(marked.model.nv)

    def positions(self, qpos: np.ndarray) -> np.ndarray:
        """Positions of the markers in the world, m (M, 3)."""
        self._data.qpos = self._followed(qpos)
        mujoco.mj_kinematics(self._model, self._data)
        return self._data.site_xpos[self._sites]

    def jacobian(self) -> np.ndarray:
        """Derivatives of the positions of the last call by the degrees of freedom that move (M, 3, n)."""
        mujoco.mj_comPos(self._model, self._data)
        for k, site in enumerate(self._sites):
            mujoco.mj_jacSite(self._model, self._data, self._all[k], None, site)
        for following in self._followers:
            slope = following.law.slope(self._data.qpos[following.leader[0]])
            self._all[:, :, following.leader[1]] += slope * self._all[:, :, following.own[1]]
        return self._all[:, :, self._dofs]

    def moved(self, qpos: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Coordinates after a step of the degrees of freedom that move (nq,)."""
        out = np.array(qpos)
        self._step[self._dofs] = step
        mujoco.mj_integratePos(self._model, out, self._step, 1.0)
        return self._followed(out)

    def _followed(self, qpos: np.ndarray) -> np.ndarray:
        """Coordinates with followers set from their leaders (nq,)."""
        if not self._followers:
            return qpos
        out = np.array(qpos)
        for following in self._followers:
            out[following.own[0]] = following.law.value(out[following.leader[0]])
        return out
