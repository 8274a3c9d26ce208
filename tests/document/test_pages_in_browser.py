"""Pages in a browser: no errors, no requests, replays that move, and accessibility."""

import os
from functools import cache
from pathlib import Path

import every_page
import pytest
from browser import browser, needs_browser
from commands import rows_of

from multicontact.__main__ import COMMANDS

pytestmark = [needs_browser, pytest.mark.slow]
AXE = os.environ.get("MULTICONTACT_AXE", "")
"""The file `axe.min.js` of the npm package axe-core, which looks for what some people cannot read."""

RED = """
const canvas = document.getElementById("view");
const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
let [number, x, y] = [0, 0, 0];
for (let k = 0; k < data.length; k += 4) {
  if (Math.abs(data[k] - 192) + Math.abs(data[k + 1] - 32) + Math.abs(data[k + 2] - 32) < 12) {
    number += 1;
    x += (k / 4) % canvas.width;
    y += Math.floor(k / 4 / canvas.width);
  }
}
return [x / number, y / number];
"""
"""Script for the mean position of the pixels of force arrows."""

RIGHT, END = "\ue014", "\ue010"  # Keys, by the standard.
CHART = "return document.querySelectorAll('canvas.chart')[arguments[0]].toDataURL()"
SLIDE = "const s = document.getElementById('slider'); s.value = arguments[0]; s.dispatchEvent(new Event('input'))"


UNFOLD = """
document.querySelectorAll("details").forEach((each) => (each.open = true));
return new Promise((done) => setTimeout(done, 100));
"""
"""Script that opens all folds, and waits until the replay is drawn in its own."""


def unfolded(window, page, **how):
    window.open(page, **how)
    window.run(UNFOLD)


@pytest.fixture(scope="module")
def page_of(tmp_path_factory):
    return cache(lambda name: every_page.written(name, tmp_path_factory.mktemp(name)))


@pytest.fixture(scope="module")
def page(page_of):
    return page_of("identify")


@pytest.fixture(scope="module")
def window():
    with browser() as opened:
        yield opened


def test_the_slider_moves_the_arrows_and_the_cursor_and_the_mechanism_turns_by_mouse_and_keys(page, window):
    unfolded(window, page)
    before, chart = window.run(RED), window.run(CHART, 0)
    window.run(SLIDE, 123)
    assert sum(abs(a - b) for a, b in zip(before, window.run(RED), strict=True)) > 2
    assert window.run(CHART, 0) != chart
    window.type("#slider", END)
    assert window.run("return document.getElementById('slider').value") == "299"
    assert window.run("return document.getElementById('time').textContent").endswith(" s")
    views = [window.run(RED)]
    window.drag("#view", (0, 0), (60, 20))
    views.append(window.run(RED))
    window.type("#view", RIGHT + RIGHT + "+")
    assert views[0] != views[1] != window.run(RED)


def test_charts_zoom_all_at_once_and_parameters_and_findings_tell_what_they_are_about(page, window):
    def charts():
        return [window.run(CHART, k) for k in (0, 5)]

    def told():
        return window.run("return document.getElementById('told').textContent")

    unfolded(window, page)
    whole = charts()
    window.click("#zoom-in")
    near = charts()
    window.click("#zoom-all")
    assert charts() == whole and whole[0] != near[0] and whole[1] != near[1]
    window.drag("canvas.chart", (-80, 0), (60, 10))
    assert charts()[1] not in (whole[1], near[1])
    window.click("[data-table=table_base_parameters] tbody tr:nth-child(5) button")
    assert "of link" in told() and "95 % interval" in told() and "regroup" not in told()
    window.click(".findings button.show")
    assert told().startswith("The finding is about ")


@pytest.mark.parametrize("name", sorted({*COMMANDS} - {"columns", "derive", "readme"}))
def test_nothing_goes_wrong_or_out_and_the_page_fits_and_every_figure_has_its_data(page_of, window, name):
    page = page_of(name)
    for drawing in page.parent.rglob("figure_*.csv"):
        rows = rows_of(drawing)
        curves = {(row["panel"], row["curve"]) for row in rows}
        assert len(rows) > 5 and (len(curves) == 1 or "" not in {curve for _, curve in curves}), drawing
        assert all(row["x_axis"] or row.get("x_category") for row in rows if row["mark"] != "span"), drawing
    for width, dark in ((400, True), (1200, False)):
        unfolded(window, page, width=width, dark=dark)
        window.run(f"if (document.getElementById('slider')) {{ {SLIDE} }}", 40)
        assert window.log("browser") == []
        assert [url for url in window.requests() if not url.startswith("data:")] == [page.resolve().as_uri()]
        assert window.run("return document.documentElement.scrollWidth <= innerWidth")
        assert window.run("return [...document.images].filter((image) => !image.naturalWidth).length") == 0
        shade = window.run("return getComputedStyle(document.body).backgroundColor")
        assert shade == ("rgb(22, 24, 27)" if dark else "rgb(255, 255, 255)")
        filters = set(window.run("return [...document.images].map((image) => getComputedStyle(image).filter)"))
        assert all("invert(1)" in each if dark else each == "none" for each in filters)
        if AXE:
            window.run(Path(AXE).read_text(encoding="utf-8"))
            violations = window.run("return axe.run({ resultTypes: ['violations'] }).then((all) => all.violations)")
            assert [(each["id"], each["nodes"][0]["html"]) for each in violations] == []


def test_printed_drawings_keep_their_proportions_and_have_a_legend(page, window):
    unfolded(window, page)
    window.devtools("Emulation.setEmulatedMedia", media="print")
    try:
        window.devtools("Emulation.setDeviceMetricsOverride", width=700, height=900, deviceScaleFactor=1, mobile=False)
        stretched = """return [...document.querySelectorAll("canvas")].map((canvas) => {
          const { width, height } = getComputedStyle(canvas);
          return parseFloat(width) / parseFloat(height) / (canvas.width / canvas.height); })"""
        window.run("dispatchEvent(new Event('beforeprint'))")
        assert window.run(stretched) == pytest.approx([1] * 7, rel=0.02)
        legend = "return [...document.querySelectorAll('.curve')].filter((each) => each.offsetHeight).length"
        assert window.run(legend) == 3
        assert window.run("return document.querySelector('.files').offsetHeight") == 0
    finally:
        window.devtools("Emulation.setEmulatedMedia", media="")


@pytest.mark.parametrize("name", ["identify", "paper"])
def test_tables_fit_their_column_and_keep_their_heads_in_sight(page_of, window, name):
    unfolded(window, page_of(name), width=1400)
    tables = "[...document.querySelectorAll('table')].map((table) => table.parentElement)"
    assert window.run(f"return {tables}.filter((each) => each.scrollWidth > each.clientWidth).length") == 0
    heads = "[...document.querySelectorAll('thead th')]"
    assert window.run(f"return {heads}.every((each) => getComputedStyle(each).position === 'sticky')")


def test_the_first_screen_has_verdict_pictures_and_findings_and_no_more(page, window):
    for width, height in ((1280, 800), (400, 1000)):
        window.open(page, width=width, height=height)
        ends = "return [...document.querySelectorAll(arguments[0])].map((each) => each.getBoundingClientRect().bottom)"
        shown = ".verdict, .picture" if width == 400 else ".verdict, .picture, .findings > li:nth-child(3)"
        assert max(window.run(ends, shown)) <= (1200 if width == 400 else height)
        assert window.run("return document.querySelectorAll('main > details[open]').length") == 0
        assert len(window.run("return document.querySelector('.verdict').textContent").split()) <= 23


def test_links_open_what_they_lead_to_and_heads_sort_within_groups(page, window):
    window.open(page)
    window.click('nav a[href="#tables"]')
    window.run("return new Promise((done) => setTimeout(done, 50))")
    assert window.run("return document.getElementById('tables').open && !document.getElementById('figures').open")
    estimates = """const table = document.querySelector("[data-table=table_base_parameters]");
      const number = (row) => Number(row.cells[1].textContent.replace("\\u2212", "-"));
      return [...table.tBodies].map((body) => [...body.querySelectorAll("tr[data-row]")].map(number))"""
    before = window.run(estimates)
    head = "[data-table=table_base_parameters] thead th:nth-child(2)"
    for times, order in enumerate((sorted, lambda x: sorted(x, reverse=True), list), 1):
        window.click(f"{head} button")
        assert window.run(estimates) == [order(group) for group in before], times
