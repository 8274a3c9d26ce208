"""Films of a page's replay, drawn by MuJoCo's renderer."""

import os
import shutil
import subprocess
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import closing
from importlib import import_module
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ident.errors import InputError
from ident.geometry import se3
from ident.mechanism.mechanism import Mechanism
from sim.models.mechanism import Origin, mujoco_origin
from sim.models.shapes import placed_geoms

WIDTH, HEIGHT = 640, 480
"""Pixels, the default size of MuJoCo's offscreen buffer."""

LONGEST = 20.0
"""Largest length of a film in s; longer motions are sped up."""

SYSTEMS = ("egl", "osmesa", "glfw")
"""MuJoCo's OpenGL systems, those that need no screen first."""

SOLID, FORCE, PRIOR = (0.1, 0.45, 0.7, 1.0), (0.75, 0.13, 0.13, 1.0), (0.5, 0.5, 0.5, 0.35)
"""Colours of estimated bodies, of forces, and of the original model's bodies: red, green, blue, opacity."""

Picture = np.ndarray
"""Rows of pixels (HEIGHT, WIDTH, 3), bytes."""


def write_film(folder: Path, arm: Mechanism, page: Mapping[str, Any]) -> str:
    """Writes `film.mp4`, or `film.gif` without ffmpeg, and returns its name.

    Args:
        folder: The folder.
        arm: The mechanism, from a model that MuJoCo reads.
        page: The replay, from `Replay.to_page`.

    Raises:
        ModelError: MuJoCo has not read the model.
        InputError: No OpenGL is available, or ffmpeg fails.
    """
    origin, time = mujoco_origin(arm), page["frames"]
    rate = max(len(time) / max(time[-1] - time[0], 1e-3), len(time) / LONGEST)
    name = "film.mp4" if shutil.which("ffmpeg") else "film.gif"
    with closing(pictures(arm, origin, page)) as drawn:
        (_write_mp4 if name.endswith("mp4") else _write_gif)(folder / name, drawn, rate)
    return name


def pictures(arm: Mechanism, origin: Origin, page: Mapping[str, Any]) -> Generator[Picture]:
    """Yields one picture for each posture.

    Raises:
        InputError: No OpenGL is available.
    """
    model, data = origin.model, mujoco.MjData(origin.model)
    mujoco.mj_forward(model, data)
    places = list(placed_geoms(arm, origin))
    with closing(_context()):
        screen = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, screen)
        scene = mujoco.MjvScene(model, model.ngeom + 3 * len(page["bodies"]) + len(page["arrows"]) + 1)
        # Without graphics hardware these take most of the time.
        for costly in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            scene.flags[costly] = False
        # Sites and tendons do not move with the bodies here.
        shown = mujoco.MjvOption()
        shown.sitegroup[:] = shown.tendongroup[:] = 0
        camera, view = _camera(arm, page), mujoco.MjrRect(0, 0, WIDTH, HEIGHT)
        pixels = np.empty((HEIGHT, WIDTH, 3), np.uint8)
        for k in range(len(page["frames"])):
            poses = arm.pose @ _poses(page["poses"][k])
            for g, body, T in places:
                T = (arm.pose if body < 0 else poses[body]) @ T
                data.geom_xpos[g], data.geom_xmat[g] = T[:3, 3], T[:3, :3].ravel()
            every = mujoco.mjtCatBit.mjCAT_ALL
            mujoco.mjv_updateScene(model, data, shown, None, camera, every, scene)
            for body, T in zip(page["bodies"], poses, strict=True):
                _add_body(scene, body, T, poses, solid=not places)
            for arrow in page["arrows"]:
                _add_arrow(scene, arm.pose, arrow, k, page)
            mujoco.mjr_render(view, scene, screen)
            mujoco.mjr_readPixels(pixels, None, view, screen)
            yield pixels[::-1].copy()


def _context() -> Any:
    """A current OpenGL context of the first system that provides one; `MUJOCO_GL` names the only one to try."""
    asked = os.environ.get("MUJOCO_GL")
    for system in (asked,) if asked else SYSTEMS:
        # Each system and driver raises errors of its own.
        try:
            context = import_module(f"mujoco.{system}").GLContext(WIDTH, HEIGHT)
            context.make_current()
        except Exception:
            continue
        return _Closed(context)
    raise InputError(
        f"A film needs OpenGL, which is not to be had here by {f'MUJOCO_GL={asked}' if asked else ', '.join(SYSTEMS)}; "
        "Mesa's libegl1 or libosmesa6 draws without a screen."
    )


class _Closed:
    """A context that is freed when it is closed."""

    def __init__(self, context: Any) -> None:
        self.close = context.free


def _camera(arm: Mechanism, page: Mapping[str, Any]) -> mujoco.MjvCamera:
    """A camera that sees the whole motion from a corner, slightly from above."""
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.lookat = arm.pose[:3, :3] @ page["center"] + arm.pose[:3, 3]
    camera.distance, camera.azimuth, camera.elevation = 2.6 * page["radius"], 130, -15
    return camera


def _poses(numbers: Sequence[float]) -> np.ndarray:
    """Poses of the bodies from positions and quaternions (b, 4, 4)."""
    each = np.reshape(numbers, (-1, 7))
    return se3.pose(se3.rotation(each[:, 3:]), each[:, :3])


def _add_body(
    scene: mujoco.MjvScene, body: Mapping[str, Any], T: np.ndarray, poses: np.ndarray, *, solid: bool
) -> None:
    """Adds the inertia ellipsoids of a body and, without shapes, a link to its parent."""
    for key, color in (("prior", PRIOR), ("estimate", SOLID if solid else (*SOLID[:3], 0.5))):
        if (numbers := body.get(key)) is not None:
            *semi_axes, centre = np.array(numbers)
            sizes = np.linalg.norm(semi_axes, axis=1)
            R = np.array([axis / max(size, 1e-12) for axis, size in zip(semi_axes, sizes, strict=True)]).T
            R = R * np.sign(np.linalg.det(R)) if np.linalg.det(R) else np.eye(3)
            place = T @ se3.pose(R, centre)
            _add(scene, mujoco.mjtGeom.mjGEOM_ELLIPSOID, np.maximum(sizes, 1e-4), place, color)
    if solid and body["parent"] >= 0:
        geom = _add(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, np.ones(3), T, PRIOR)
        start = poses[body["parent"]][:3, 3]
        mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, 0.01, start, T[:3, 3])


def _add_arrow(
    scene: mujoco.MjvScene, world: np.ndarray, arrow: Mapping[str, Any], k: int, page: Mapping[str, Any]
) -> None:
    """Adds a force, as long as on the page."""
    own, radius, largest = slice(3 * k, 3 * k + 3), page["radius"], page["largest"]
    start, force = np.array(arrow["points"][own]), np.array(arrow["forces"][own])
    if np.linalg.norm(force) <= 0.01 * largest:
        return
    ends = [world[:3, :3] @ x + world[:3, 3] for x in (start, start + 0.8 * radius / largest * force)]
    geom = _add(scene, mujoco.mjtGeom.mjGEOM_ARROW, np.ones(3), np.eye(4), FORCE)
    mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_ARROW, 0.015 * radius, *ends)


def _add(
    scene: mujoco.MjvScene, kind: mujoco.mjtGeom, size: np.ndarray, T: np.ndarray, color: Sequence[float]
) -> mujoco.MjvGeom:
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, size, T[:3, 3].copy(), T[:3, :3].flatten(), np.array(color, np.float32))
    scene.ngeom += 1
    return geom


def _write_gif(path: Path, drawn: Iterator[Picture], rate: float) -> None:
    from PIL import Image

    first, *others = (Image.fromarray(each).quantize(64) for each in drawn)
    first.save(path, save_all=True, append_images=others, duration=max(20, round(1000 / rate)), loop=0)


def _write_mp4(path: Path, drawn: Iterator[Picture], rate: float) -> None:
    """Writes an MP4 by ffmpeg, which receives all pictures on its input."""
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{WIDTH}x{HEIGHT}", "-r", f"{rate:.3f}", "-i", "-"]
    command = ["ffmpeg", "-loglevel", "error", "-y", *source, "-pix_fmt", "yuv420p", str(path)]
    done = subprocess.run(command, input=b"".join(each.tobytes() for each in drawn), capture_output=True, check=False)
    if done.returncode:
        raise InputError(f"ffmpeg could not write the film: {done.stderr.decode(errors='replace').strip()}")
