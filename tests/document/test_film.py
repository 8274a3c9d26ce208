"""Films: drawn if there is OpenGL; otherwise a sentence beside complete results."""

import shutil
from itertools import pairwise

import numpy as np
import pytest
from commands import refusal
from pages import options
from PIL import Image
from truth import use_truth

import scenes
from experiments import identify, misaligned
from experiments.document import film, replay
from experiments.document.replay import Replay
from ident.errors import InputError
from ident.mechanism.motion import Motion
from ident.recordings.recording import Recording
from sim.models.mechanism import mechanism


@pytest.fixture
def moving():
    arm, time = mechanism(scenes.load("double_pendulum"), "base"), np.arange(4) / 10
    force = np.tile([0.0, 0.0, 200.0], (4, 1))
    recording = Recording(time, {"ground_force": force, "ground_torque": 0 * force})
    motion = Motion(np.outer(time, [2.0, 1.0]), np.zeros((4, 2)), np.zeros((4, 2)))
    values = {"measured": force[:, 2:]}
    return arm, Replay(arm, recording, motion, [("Fz", "N")], np.arange(4), values, estimate=arm.known).to_page()


def test_pictures_differ_from_one_another_and_become_a_film(moving, tmp_path, monkeypatch):
    monkeypatch.setattr(film.shutil, "which", lambda name: None)
    try:
        name = film.write_film(tmp_path, *moving)
    except InputError as error:
        pytest.skip(str(error))
    with Image.open(tmp_path / name) as drawn:
        assert (name, drawn.n_frames, drawn.size) == ("film.gif", 4, (film.WIDTH, film.HEIGHT))
        pictures = []
        for k in range(4):
            drawn.seek(k)
            pictures.append(np.asarray(drawn.convert("RGB"), int))
    assert all(abs(a - b).max() > 50 for a, b in pairwise(pictures))


def test_without_opengl_there_is_a_sentence(moving, tmp_path, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "nothing")
    with pytest.raises(InputError, match="A film needs OpenGL, which is not to be had here by MUJOCO_GL=nothing; "):
        film.write_film(tmp_path, *moving)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("name", ["film.gif", "film.mp4"])
def test_a_study_has_a_film_in_either_format(name, tmp_path, monkeypatch, capsys):
    encoder = shutil.which("ffmpeg") if name == "film.mp4" else None
    if name == "film.mp4" and not encoder:
        pytest.skip("ffmpeg is not on PATH, so no MP4 is written")
    use_truth(monkeypatch)
    monkeypatch.setattr(replay, "FRAMES", 3)
    monkeypatch.setattr(film.shutil, "which", lambda _: encoder)
    (tmp_path / {"film.gif": "film.mp4", "film.mp4": "film.gif"}[name]).touch()
    code = misaligned.main(["--samples", "60", "--formats", "png", "--film", "--out", str(tmp_path)])
    if "A film needs OpenGL" in (output := capsys.readouterr().err):
        pytest.skip(output)
    assert code == 0
    assert [path.name for path in tmp_path.glob("film.*")] == [name] and (tmp_path / name).stat().st_size > 1000
    assert f'href="{name}"' in (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("undrawn")
def test_the_results_are_written_all_the_same(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("MUJOCO_GL", "nothing")
    error = refusal(identify.main, options(tmp_path, "--film"), capsys)
    assert "error: All but the film is written: A film needs OpenGL" in error
    assert (tmp_path / "out" / "report.html").exists() and not list((tmp_path / "out").glob("film.*"))
