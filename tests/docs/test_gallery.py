"""Pictures of the gallery: every script runs without a warning, draws one figure, and shows what its text says."""

import contextlib
import io
import re
from pathlib import Path

import matplotlib
import pytest

import experiments

FOLDER = Path(experiments.__file__).parents[1] / "docs" / "gallery"
pytestmark = [pytest.mark.skipif(not FOLDER.exists(), reason="only a checkout has docs"), pytest.mark.slow]

EXPECTED = {
    "coverage": r"9[2-8] of 100 intervals contain the truth",
    "delay": r"is (7\.[789]\d|8\.[012]\d) ± 0\.\d\d ms late",
    "designed_excitation": r"motions': 0\.[2-6]\d",
    "friction": r"Coulomb (1\.0|0\.99)\d* N m, viscous 0\.(79|80|81) N m s",
    "misaligned_axes": r"largest error 1\.\d",
    "pendulum": "",
    "person_segments": r"1[123] of 13 intervals contain the truth",
    "regrouping": r"48 of 70",
    "residual_spectra": r"along X: residual [1-9]\.\d+ N m\naxes as they are: residual 0\.0\d+ N m",
    "total_wrench": r"largest difference [0-3]\.\d",
    "two_recordings": r"along X: root mean square [3-9]\.\d\naxes as they are: root mean square (0\.\d|1\.[0-3])",
    "updated_model": r"came: [1-9]\d\.\d mrad\nupdated model: [01]\.\d mrad",
}
"""What each script prints of its picture."""


def test_there_are_twelve_short_scripts():
    scripts = {path.stem: path.read_text(encoding="utf-8") for path in FOLDER.glob("*.py")}
    assert set(scripts) == set(EXPECTED) and len(scripts) == 12
    for name, text in scripts.items():
        assert re.match(r"# # .+\n#\n# .+\.\n\n", text), name
        assert len([line for line in text.splitlines() if line.strip() and not line.startswith("#")]) <= 45, name


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_scripts_draw_what_their_text_says(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    matplotlib.use("Agg")
    from matplotlib import pyplot

    script = FOLDER / f"{name}.py"
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(script.read_text(encoding="utf-8"), str(script), "exec"), {"__name__": "__main__"})
    (number,) = pyplot.get_fignums()
    figure = pyplot.figure(number)
    figure.savefig(tmp_path / "picture.png", dpi=60)
    pyplot.close(figure)
    assert figure.get_suptitle() and all(ax.get_xlabel() or ax.get_ylabel() for ax in figure.axes if ax.axison)
    assert re.search(EXPECTED[name], printed.getvalue())
