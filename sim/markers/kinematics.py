"""Positions of a model's markers and their derivatives by its degrees of freedom, as MuJoCo computes them."""

import mujoco
import numpy as np

from sim.markers.marked_model import MarkedModel


class Kinematics:
    """Positions and Jacobians of the markers of a model; one at a time, in memory of its own."""

    def __init__(self, marked: MarkedModel) -> None:
        self._model, self._data = marked.model, mujoco.MjData(marked.model)
        self._sites, self._dofs = marked.sites, marked.dofs
        self._all = np.zeros((len(marked.sites), 3, marked.model.nv))
        self._step = np.zeros(marked.model.nv)

    def positions(self, qpos: np.ndarray) -> np.ndarray:
        """Positions of the markers in the world, m (M, 3)."""
        self._data.qpos = qpos
        mujoco.mj_kinematics(self._model, self._data)
        return self._data.site_xpos[self._sites]

    def jacobian(self) -> np.ndarray:
        """Derivatives of the positions asked for last by the degrees of freedom that move (M, 3, n)."""
        mujoco.mj_comPos(self._model, self._data)
        for k, site in enumerate(self._sites):
            mujoco.mj_jacSite(self._model, self._data, self._all[k], None, site)
        return self._all[:, :, self._dofs]

    def moved(self, qpos: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Coordinates after a step of the degrees of freedom that move (nq,)."""
        out = np.array(qpos)
        self._step[self._dofs] = step
        mujoco.mj_integratePos(self._model, out, self._step, 1.0)
        return out
