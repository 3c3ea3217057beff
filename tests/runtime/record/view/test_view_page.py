"""The page of `view` in a real browser: signals, timeline, strides, two trials over each other, and pictures."""

import base64
import importlib.resources
import re
import xml.etree.ElementTree as ElementTree
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.graph.drawing.browser import needs_browser
from tests.runtime.record.panel.chromium import browser
from tests.runtime.record.panel.panels import free_port
from tests.runtime.record.panel.test_page import violations
from tests.runtime.record.view.recorded import trial, viewing
from tests.runtime.record.view.test_view import damaged

pytestmark = [needs_browser, pytest.mark.paced]
WINDOW = "document.getElementById('brush').ariaValueText"
TITLES = "[...document.querySelectorAll('.chart h3')].map((it) => it.innerText)"
SAVED = """(() => { const made = URL.createObjectURL; window.saved = null; URL.createObjectURL = (file) => {
    const reader = new FileReader(); reader.onload = () => { window.saved = reader.result; };
    reader.readAsDataURL(file); return made.call(URL, file); }; })()"""

# the picture of a plot over the gait cycle whose foot lifts at 62 %
TOE_OFF = """Promise.all([import('./charts.js'), import('./picture.js')]).then(([{ StrideChart }, { svg }]) => {
  const curves = [{ name: 'x', mean: [0, 1], sd: [0, 0], place: 0, shown: '' }];
  const chart = { range: [0, 1], title: 't', toeOffs: [{ at: 0.62, place: 1 }], curves };
  return svg([StrideChart.prototype.figure.call(chart)], { width: 85 });
})"""


@pytest.fixture(scope="module")
def trials(tmp_path_factory):
    folder = tmp_path_factory.mktemp("view")
    return [trial(folder, "without", torque=1.0), trial(folder, "assisted", mark=1000)]


@pytest.fixture(scope="module")
def new_tab(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("browser")) as new_tab:
        yield new_tab


def opened(new_tab, address):
    tab = new_tab(address)
    tab.look(1400)
    tab.wait_for("document.querySelectorAll('.chart canvas').length > 0 && document.getElementById('loading').hidden")
    tab.wait_for("[...document.querySelectorAll('.legend .value')].every((it) => /\\d/.test(it.innerText))")
    return tab


def keys(tab, *names):
    for name in names:
        tab.evaluate(f"dispatchEvent(new KeyboardEvent('keydown', {{ key: {name!r}, bubbles: true }}))")
    tab.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def saved(tab, kind):
    tab.evaluate(SAVED)
    tab.click(f"#saving button[value={kind}]")
    return base64.b64decode(tab.wait_for("window.saved").partition(",")[2])


def test_one_recording_is_shown_moved_read_and_saved(trials, new_tab, tmp_path):
    with viewing(tmp_path, trials[0]) as (_, address):
        tab = opened(new_tab, address)
        assert tab.evaluate(TITLES) == ["Knee position", "Knee torque"]
        assert tab.evaluate("[...document.querySelectorAll('.legend li')].map((it) => it.innerText)")[0].split() == [
            *("left", "0.0", "to", "114.6°")
        ]
        assert tab.text("#word") == "Complete" and tab.evaluate(WINDOW) == "0.0 s to 20.0 s"
        # events lead to their place
        tab.evaluate("document.getElementById('happened').open = true")
        tab.wait_for("document.querySelectorAll('#log button').length === 4")
        assert "Mark 1: new shoes" in tab.text("#log li.mark")
        tab.click("#log li.mark button")
        tab.wait_for(f"{WINDOW} === '0.0 s to 10.0 s'")
        keys(tab, "n")
        assert tab.evaluate(WINDOW) == "1.0 s to 11.0 s" and "gain 1 to 2.5" in tab.text("#told")
        # keys, wheel and drag
        keys(tab, "ArrowRight", "+")
        assert tab.evaluate(WINDOW) == "4.0 s to 9.0 s"
        place = tab.evaluate(
            "(() => { const box = document.querySelector('.u-over').getBoundingClientRect();"
            " return [box.x + box.width / 2, box.y + 50, box.width]; })()"
        )
        mouse = {"x": place[0], "y": place[1]}
        tab.call("Input.dispatchMouseEvent", type="mouseWheel", deltaX=0, deltaY=-200, modifiers=2, **mouse)
        tab.wait_for(f"{WINDOW} !== '4.0 s to 9.0 s'")
        first, last = map(float, re.findall(r"[\d.]+", tab.evaluate(WINDOW)))
        assert last - first < 5.0 and abs(first + last - 13.0) < 0.3  # about the pointer
        for kind, by in (("mousePressed", 0.0), ("mouseMoved", -0.25), ("mouseReleased", -0.25)):
            at = {"x": place[0] + by * place[2], "y": place[1]}
            tab.call("Input.dispatchMouseEvent", type=kind, button="left", buttons=1, clickCount=1, **at)
        tab.wait_for(f"parseFloat({WINDOW}) > {first + 0.2 * (last - first)}")
        # two fingers that part zoom in between them, and one moves
        keys(tab, "0")
        before = []
        for shares in ([-0.05, 0.05], [-0.2, 0.2], [], [0.0], [-0.4], []):
            kind = "touchEnd" if not shares else "touchMove" if before else "touchStart"
            points = [{"x": place[0] + at * place[2], "y": place[1], "id": key} for key, at in enumerate(shares)]
            tab.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)
            before = shares
        assert tab.evaluate(WINDOW) == "9.5 s to 14.5 s"
        # values at the cursor, for screen readers too
        keys(tab, "0", ".")
        assert re.match(r"\d+\.\d\d s: knee position left [\d.]+°, right [\d.]+°; knee torque", tab.text("#told"))
        # fine enough to see each sample
        keys(tab, *["+"] * 8)
        tab.wait_for("document.querySelector('.plot').ariaLabel.includes('left')")
        figure = ElementTree.fromstring(saved(tab, "svg"))
        assert figure.get("width") == "85mm"
        texts = [text.text for text in figure.iter("{http://www.w3.org/2000/svg}text")]
        assert {"Knee position (°)", "Knee torque (N·m)", "time (s)", "left", "right"} <= set(texts)
        assert saved(tab, "png").startswith(b"\x89PNG")
        assert tab.problems == []


@pytest.mark.soak
@pytest.mark.skipif(find_spec("axe_core_python") is None, reason="of the extra `test`")
def test_two_trials_lie_over_each_other_by_time_and_by_stride(trials, new_tab, tmp_path):
    with viewing(tmp_path, *trials) as (_, address):
        tab = opened(new_tab, address)
        assert tab.evaluate(TITLES)[0] == "Knee position, left"
        assert tab.evaluate("[...document.querySelectorAll('.legend')][1].innerText").split() == [
            *("without", "0.0", "to", "1.0", "N·m", "assisted", "0.0", "to", "5.0", "N·m")
        ]
        tab.evaluate(
            "(() => { const align = document.getElementById('align'); align.value = 'mark 1'; "
            "align.dispatchEvent(new Event('change')); })()"
        )
        tab.wait_for(f"{WINDOW} === '−1.0 s to 20.0 s'")
        assert tab.evaluate("[...document.querySelectorAll('#recordings input')].map((it) => it.value)") == ["0", "-1"]
        tab.click("#tab-strides")
        tab.wait_for("document.querySelectorAll('.leg').length === 2")
        assert tab.evaluate(TITLES.replace(".chart", ".leg .chart")) == [
            f"Knee {curve}, {side}" for side in ("left", "right") for curve in ("angle", "torque", "power")
        ]
        table = tab.text(".leg table")
        assert "without" in table and re.search(r"Torque, peak\s+1\.00 ± 0\.00 N·m\s+5\.00 ± 0\.00 N·m", table), table
        assert b"assisted, " in saved(tab, "svg")
        drawn = ElementTree.fromstring(tab.evaluate(TOE_OFF))
        [line] = drawn.findall(".//{*}line[@stroke-dasharray='1 2']")
        low, high = (float(tick.get("x1")) for tick in drawn.findall(".//{*}line[@stroke-width='0.6']")[0:6:5])
        assert float(line.get("x1")) == pytest.approx(low + 0.62 * (high - low), abs=0.02)
        tab.evaluate(importlib.resources.files("axe_core_python").joinpath("axe.min.js").read_text())
        for width in (390, 1024, 1920):
            tab.look(width, dark=width == 1024)
            for name in ("strides", "curves"):
                tab.click(f"#tab-{name}")
                tab.wait_for(f"!document.getElementById('{name}').hidden")
                assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth"), (width, name)
                assert violations(tab) == []
        assert tab.problems == []


@pytest.mark.soak
def test_a_damaged_recording_and_a_lost_process_are_reported(trials, new_tab, tmp_path):
    path = trial(tmp_path, "walk", ticks=20_000)
    damaged(path)
    port = ("--port", str(free_port()))
    with viewing(tmp_path, path, *port) as (process, address):
        tab = opened(new_tab, address)
        assert tab.text("#word") == "Incomplete" and f"{Path(path).name} is damaged" in tab.text("#alarm")
        tab.evaluate("window.before = true")
        process.kill()
        tab.wait_for("document.getElementById('alarm').innerText.startsWith('No link')")
    with viewing(tmp_path, path, *port):
        tab.wait_for("document.getElementById('alarm').innerText.includes('is damaged')")
        keys(tab, *["+"] * 8)
        tab.wait_for("document.querySelector('.plot').ariaLabel.includes('50.2 s')")
        assert tab.evaluate("window.before")
    with viewing(tmp_path, trials[0], *port):  # another recording
        tab.wait_for("!window.before && document.getElementById('word')?.innerText === 'Complete'")
