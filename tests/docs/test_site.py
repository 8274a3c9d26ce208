"""The site as `make docs` builds it: strictly, from tutorials that run, with pages that request nothing elsewhere."""

import re
import shutil
import subprocess
from html import unescape
from pathlib import Path

import pytest

import experiments

pytest.importorskip("mkdocs", reason="the extra docs builds the site")
pytest.importorskip("latex2mathml", reason="the extra docs builds the site")

ROOT = Path(experiments.__file__).parents[1]
pytestmark = [
    pytest.mark.extras,
    pytest.mark.skipif(not (ROOT / "mkdocs.yml").exists(), reason="only a checkout has a mkdocs.yml"),
    pytest.mark.filterwarnings("ignore"),
]

EXPECTED = {
    "paper": (r"Ixz2 +-2\.\d+ &lt;- wrong", r"ignored: largest error \d", r"error: simplified 2\.\d+, full 0\.0\d"),
    "arm": (r"is 1[12]\.\d+ ± 0\.\d+ ms late", "Usable to predict", r"fore: 2\.00 kg .*, 2\.[78]\d kg identified"),
    "servo": (r"Servo\(kp=80\.0", r"Fc\(lift\): (1\.0|0\.9)\d+ ± 0\.\d+, true 1\.000", r"Ia\(bend\): 0\.0[45]"),
    "gripper": ("29 of 70", "Usable to predict wrenches", r"gripper: 0\.8[12]\d+ ± 0\.00\d+ kg, true 0\.8200 kg"),
    "person": (
        r"Partly usable: it predicts all channels (that count )?but F., M.",
        r"(9\d|100) % of the 95 %",
        r"person: 66\.1 kg .* 6[78]\.\d kg identified",
    ),
    "condition_number": (r"they are: condition number 33\d", r"deviations 1\.\d+ times", r"Ixx2 off by -1\."),
}
"""Output that each tutorial's page shows."""
GALLERY = {
    "accuracy": (
        r"9[2-8] of 100 intervals contain the truth",
        r"along X: root mean square [3-9]\.\d\naxes as they are: root mean square (0\.\d|1\.[0-3])",
        r"along X: residual [1-9]\.\d+ N m\naxes as they are: residual 0\.0\d+ N m",
        r"motions': 0\.[2-6]\d",
        r"1[123] of 13 intervals contain the truth",
    ),
    "mechanisms": (
        "",
        r"largest difference [0-3]\.\d",
        r"48 of 70",
        r"largest error 1\.\d",
        r"is (7\.[789]\d|8\.[012]\d) ± 0\.\d\d ms late",
        r"Coulomb (1\.0|0\.99)\d* N m, viscous 0\.(79|80|81) N m s",
        r"[89] of 9 intervals contain the truth, 4 known to 0\.1 mm",
    ),
}
"""Text that each script of the gallery prints of its pictures, in their order."""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    folder = tmp_path_factory.mktemp("site")
    config = load_config(str(ROOT / "mkdocs.yml"), site_dir=str(folder), strict=True)
    config.plugins.on_startup(command="build", dirty=False)
    build(config)
    return folder


def test_tutorials_run_and_show_what_they_print(site):
    assert {path.stem for path in (ROOT / "docs" / "tutorials").glob("*.py")} == set(EXPECTED)
    for name, patterns in EXPECTED.items():
        page = re.sub(r"<[^>]+>", "", (site / "tutorials" / f"{name}.html").read_text(encoding="utf-8"))
        assert [pattern for pattern in patterns if not re.search(pattern, page)] == [], name
        assert (site / "tutorials" / f"{name}_0.png").stat().st_size > 10_000


def test_pages_load_nothing_from_elsewhere(site):
    loaded = re.compile(r"""<(?:script|link|img|iframe|source)\b[^>]*?(?:src|href)=["']?([^"' >]+)""")
    for page in site.rglob("*.html"):
        wanted = loaded.findall(page.read_text(encoding="utf-8"))
        # A report has its pictures and scripts in itself.
        assert wanted or page.name == "report.html", page
        assert [target for target in wanted if re.match(r"(\w+:)?//", target)] == [], page
        folder = site if page.name == "404.html" else page.parent
        assert [x for x in wanted if not (folder / re.split("[?#]", x)[0].lstrip("/")).exists()] == [], page
    assert [*site.rglob("*.py*")] == [], "scripts and their caches are no pages"
    for style in site.rglob("*.css"):
        text = style.read_text(encoding="utf-8")
        assert not re.search(r"""(?:url\(|@import)\s*["']?(?:https?:)?//""", text), style


def test_equations_link_to_functions_and_functions_back(site):
    page = (site / "equations.html").read_text(encoding="utf-8")
    parts = re.split(r'<a id="eq-(\d+)"></a>(?:<a id="eq-\d+"></a>)*', page.partition('id="axes-from-poses"')[0])
    assert parts[1] == "1" and parts[-2] == "17" and len(parts) > 28
    for number, text in zip(parts[1::2], parts[2::2], strict=True):
        targets = re.findall(r'href="(reference/\w+\.html)#([\w.]+)"><code>ident', text)
        assert targets, number
        for file, name in targets:
            reference = (site / file).read_text(encoding="utf-8")
            entry = reference[reference.index(f'id="{name}"') :].split("<h2 ")[0]
            assert f'equations.html#eq-{number}"' in entry, name


def test_the_gallery_shows_the_pictures_of_every_script_and_what_it_prints(site):
    page = (site / "gallery.html").read_text(encoding="utf-8")
    scripts = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / "docs" / "gallery").glob("*.py")}
    assert set(scripts) == set(GALLERY)
    for name, text in scripts.items():
        shown = unescape(re.sub(r"<[^>]+>", "", (site / "gallery" / f"{name}.html").read_text(encoding="utf-8")))
        assert text.count("plt.subplots(") == text.count("\n# ## ") == len(GALLERY[name]), name
        for k, printed in enumerate(GALLERY[name]):
            assert f'<a href="gallery/{name}.html#figure-{k}"><img src="gallery/{name}_{k}.png"' in page
            assert re.search(printed, shown), printed
            assert (site / "gallery" / f"{name}_{k}.png").stat().st_size > 8_000
        assert not (site / "gallery" / f"{name}_{len(GALLERY[name])}.png").exists()


def test_the_reference_has_every_name_of_the_front_doors(site):
    import ident
    import sim

    for package in (ident, sim):
        page = (site / "reference" / f"{package.__name__}.html").read_text(encoding="utf-8")
        assert [name for name in package.__all__ if f'.{name}"' not in page] == []


@pytest.mark.skipif(shutil.which("chromium") is None, reason="the browser chromium is not installed")
def test_a_browser_has_nothing_to_complain_of(site, tmp_path):
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", f"--user-data-dir={tmp_path}"]
    for page in ("index.html", "equations.html", "tutorials/arm.html"):
        command = ["chromium", *options, "--dump-dom", (site / page).as_uri()]
        ended = subprocess.run(command, capture_output=True, text=True, timeout=120)
        assert "</html>" in ended.stdout and "CONSOLE" not in ended.stderr, ended.stderr
