"""The page of the panel in a real browser: it shows the run, stops it, changes parameters, and admits a lost link."""

import importlib.resources
import json
import os
import re
import signal

import pytest

from blocks.states import StateMachine
from graph import Diagram
from graph.drawing import draw, svg
from runtime.host.options import settings
from tests.graph.drawing.browser import needs_browser
from tests.runtime.record.panel.chromium import browser
from tests.runtime.record.panel.panels import running
from tests.runtime.runs import assert_safely_stopped, descendant, write
from tests.soaking import soaked

pytestmark = [needs_browser, pytest.mark.paced]
ROW = "document.querySelector('[data-path=\"left/law.gain\"]')"
RUNNING = "document.getElementById('word').innerText === 'Running'"
# Strides of 0.6 s, and a height whose largest values in them are 1.0, 1.2 and 1.4 m in turn.
WALK = """
    from blocks.sinks import Panel

    class Walk(Block):
        strides = Output("1", dtype=int)
        height = Output("m")

        def step(self, t):
            count = int(t / 0.6)
            return count, (1.0 + 0.2 * (count % 3)) * math.sin(math.pi * (t / 0.6 - count))

    Walk(name="walk")
    Panel(marks=("start", "uphill"), subject="walk.height", stride="maximum", target=(1.1, 1.3))
"""


@pytest.fixture
def opened(tmp_path):
    """(run, tab) of a run whose page is open."""
    with running(tmp_path) as run, browser(tmp_path) as new_tab:
        tab = new_tab(run.address)
        tab.wait_for(RUNNING)
        yield run, tab


def test_page_loads_without_errors_and_shows_values_that_change(opened):
    _, tab = opened
    assert tab.text("#name") == "robot" and tab.text("#kind") == "simulation"
    assert len(tab.evaluate("[...document.querySelectorAll('.actuator h2')].map((it) => it.innerText)")) == 2
    torque = "document.querySelector('.actuator .torque b').innerText"
    first = tab.wait_for(f"{torque}.endsWith('N·m') && {torque}")
    tab.wait_for(f"{torque} !== {first!r}")
    health = "document.getElementById('health').innerText"
    tab.wait_for(f"/legs\\n[1-9]\\d* sent, [1-9]\\d* received, [1-9]\\d* %/i.test({health})")
    tab.wait_for(f"/oldest reply in 10 s\\n\\S+ [mµ]s, knee/i.test({health})")
    tab.wait_for(f"/lost replies, knee, left\\n\\d+\\n/i.test({health})")
    tab.evaluate("document.getElementById('tab-plots').click()")
    tab.wait_for("document.querySelectorAll('#charts canvas').length === 2")
    assert tab.evaluate("['events', 'timing'].every((id) => document.getElementById(id).checkVisibility())")
    assert tab.problems == []


@pytest.mark.hazard("H9f")
@pytest.mark.parametrize("how", soaked(["tap", "space", "space in a field", "space on another tab"], but=[3]))
def test_stop_of_the_page_ends_the_run_with_its_safe_stop(opened, how):
    run, tab = opened
    if how == "tap":
        tab.click("#stop")
    else:
        if how == "space in a field":
            tab.evaluate("document.querySelector('.parameter input[type=number]').focus()")
        elif how == "space on another tab":
            tab.evaluate("document.getElementById('tab-plots').click()")
        tab.press(" ", "Space")
    code, said = run.end()
    assert code == 0 and "stopped by page 1 of the panel" in said
    assert_safely_stopped(run.files, (1, 2))
    tab.wait_for("document.getElementById('word').innerText === 'Ended'")
    assert tab.evaluate("document.getElementById('stop').disabled && document.body.classList.contains('stale')")


@pytest.mark.soak
def test_space_in_the_search_of_signals_is_a_letter(opened):
    run, tab = opened
    tab.evaluate("document.getElementById('tab-plots').click(); document.getElementById('filter').focus()")
    tab.press(" ", "Space")
    tab.evaluate("new Promise((done) => setTimeout(done, 500))")
    assert tab.evaluate(RUNNING) and tab.evaluate("document.getElementById('filter').value") == " "


def test_slider_of_both_sides_changes_both_and_shows_what_is_applied(opened):
    run, tab = opened
    tab.wait_for(f"!{ROW}.querySelector('input').disabled")
    move_slider(tab, 2.5)
    tab.wait_for(f"{ROW}.querySelector('.applied').innerText === 'applied: 2.5 N·m'")
    tab.evaluate("document.getElementById('note').focus()")
    for key, code in (("a", "KeyA"), (" ", "Space"), ("b", "KeyB")):
        tab.press(key, code)
    tab.click("#mark")
    tab.wait_for("document.getElementById('log').innerText.includes('Mark 1: a b')")
    tab.click("#stop")
    assert run.end()[0] == 0
    events = [event for event in run.files.sidecar["events"] if event["event"] == "set"]
    assert {(event["path"], event["value"], event["tick"]) for event in events} == {
        (f"{side}/law.gain", 2.5, events[0]["tick"]) for side in ("left", "right")
    }
    assert tab.problems == [] or all("WebSocket" in problem for problem in tab.problems)  # after the end of the run


@pytest.mark.soak
def test_the_value_at_which_a_slider_is_let_go_is_asked_for_although_a_status_comes_right_after(opened):
    _, tab = opened
    asked = tab.evaluate("""(async () => {
        const { Parameters } = await import("/parameters.js");
        const parent = document.createElement("p"), both = document.createElement("input"), orders = [];
        const tools = document.getElementById("tools").cloneNode(true);
        parent.append(both);
        const each = { path: "law.gain", port: "gain", block: "law", unit: "N·m", shown: "N·m", factor: 1, low: 0,
                       high: 3, built: 1, dtype: "float", description: "" };
        const send = (order) => orders.push(order.changes[0][1]);
        const made = new Parameters(document.createElement("div"), both, send, tools);
        made.build([each], "it");
        const slider = made.rows[0].slider;
        for (const value of [2, 2.5]) {  // the second may be sent 0.1 s after the first
            slider.value = value;
            slider.dispatchEvent(new Event("input"));
            if (value === 2) await new Promise((done) => setTimeout(done, 20));
        }
        slider.dispatchEvent(new Event("change"));
        for (const id of orders.keys()) made.answered({ id: id + 1, taken: true });
        made.show([[1, 1]], true);  // of a tick before that
        await new Promise((done) => setTimeout(done, 300));
        return orders;
    })()""")
    assert asked == [2, 2.5]


def move_slider(tab, value):
    tab.evaluate(
        f"(() => {{ const slider = {ROW}.querySelector('input[type=range]'); slider.value = {value}; "
        "for (const name of ['input', 'change']) slider.dispatchEvent(new Event(name, {bubbles: true})); })()"
    )


@pytest.mark.soak
def test_settings_are_undone_saved_and_loaded(opened, tmp_path):
    run, tab = opened

    def applied(value):
        tab.wait_for(f"{ROW}.querySelector('.applied').innerText === 'applied: {value} N·m'")

    def load(text):
        tab.upload("#tools input", write(tmp_path, text, "values.set"))

    tab.wait_for(f"!{ROW}.querySelector('input').disabled && document.getElementById('undo').disabled")
    move_slider(tab, 2.5)
    applied("2.5")
    tab.evaluate(
        "(() => { const made = URL.createObjectURL; URL.createObjectURL = (file) => { "
        "file.text().then((text) => { window.saved = text; }); return made.call(URL, file); }; })()"
    )
    tab.click("#save")
    saved = tab.wait_for("window.saved")
    both = [("left/law.gain", "2.5"), ("right/law.gain", "2.5")]
    assert settings([f"@{write(tmp_path, saved, 'saved.set')}"]) == both
    tab.click("#undo")
    applied("1.0")
    load("# of another day\nleft/knee.disabled=false\n" + saved)
    applied("2.5")
    assert tab.text("#tools span") == "Asked for 2 of its values"
    load("left/law.gain=0.5\nleft/law.gian=1\nright/law.gain=much\nleft/knee.disabled=true\n")
    tab.wait_for("document.querySelector('#tools span').innerText.startsWith('Nothing')")
    assert "This run cannot take: left/law.gian=1, right/law.gain=much, left/knee.disabled=true" in tab.text(
        "#tools span"
    )
    load("left/law.gain=99\n")
    tab.wait_for(f"{ROW}.querySelector('.applied').innerText.startsWith('not changed')")
    tab.click("#stop")
    assert run.end()[0] == 0
    changes = [event["value"] for event in run.files.sidecar["events"] if event["event"] == "set"]
    assert changes == [2.5, 2.5, 1.0, 1.0, 2.5, 2.5]


@pytest.mark.hazard("H9g")
@pytest.mark.timing
def test_lost_link_is_shown_within_half_a_second_and_a_stop_is_not_claimed(opened):
    run, tab = opened
    panel = descendant(run.process.pid, "tickwork-panel")
    tab.evaluate(  # the page's own account, since a busy machine keeps the test from looking
        "alarms = []; new MutationObserver(() => alarms.push([alarm.textContent, document.body.className]))"
        ".observe(alarm = document.getElementById('alarm'), { childList: true })"
    )
    os.kill(panel, signal.SIGSTOP)
    text, state = tab.wait_for("!alarm.hidden && alarms[0]")
    assert re.match(r"Link lost\. These values are 0\.[45] s old", text) and "stale" in state.split(), (text, state)
    assert "cannot stop the robot" in tab.text("#alarm")
    tab.press(" ", "Space")
    assert "NOT SENT" in tab.text("#stop")
    os.kill(panel, signal.SIGCONT)  # the stop is still wanted
    assert run.end()[0] == 0


@pytest.mark.soak
def test_page_connects_to_the_panel_that_replaces_a_dead_one(opened):
    run, tab = opened
    tab.evaluate(  # the next panel may be there before the test has looked
        "lost = false; new MutationObserver(() => { lost ||= !document.getElementById('alarm').hidden; })"
        ".observe(document.getElementById('alarm'), { attributes: true })"
    )
    os.kill(descendant(run.process.pid, "tickwork-panel"), signal.SIGKILL)
    tab.wait_for("lost")
    tab.wait_for(f"document.getElementById('alarm').hidden && {RUNNING}")
    tab.press(" ", "Space")
    assert run.end()[0] == 0


@pytest.mark.soak
@pytest.mark.parametrize("width", soaked([390, 1024, 1920], but=[0]))
def test_page_fits_its_window(opened, width):
    _, tab = opened
    tab.look(width)
    for name in ("operate", "plots"):
        tab.evaluate(f"document.getElementById('tab-{name}').click()")
        tab.wait_for(f"!document.getElementById('{name}').hidden")
        assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")


@pytest.mark.soak
def test_pages_are_accessible_in_light_and_dark(tmp_path):
    pytest.importorskip("axe_core_python")  # of the extra `test`
    with running(tmp_path, more=WALK) as run, browser(tmp_path) as new_tab:
        page, subject = new_tab(run.address), new_tab(f"{run.address}subject")
        page.wait_for(RUNNING)
        subject.wait_for("!document.body.classList.contains('old')")
        views = [(page, f"document.getElementById('tab-{name}').click()") for name in ("operate", "plots")]
        views.append((subject, "document.getElementById('choice').open = true"))
        for tab, show in views:
            tab.evaluate(f"{importlib.resources.files('axe_core_python').joinpath('axe.min.js').read_text()}; {show}")
            for dark in (False, True):
                tab.look(1400, dark)
                assert violations(tab) == []
        subject.evaluate("document.getElementById('low').labels[0].replaceWith(document.getElementById('low'))")
        assert [rule for rule, _ in violations(subject)] == ["label"]  # axe does find what is wrong


def violations(tab):
    """What axe finds wrong with a page: [(rule, elements)]."""
    return tab.evaluate(
        "axe.run().then(({ violations }) => violations.map(({ id, nodes }) => [id, nodes.map(({ html }) => html)]))"
    )


def test_fault_is_shown_with_cause_remedy_and_report(tmp_path):
    law = "return math.nan if __import__('os').path.exists('fault') else 0.0"
    with running(tmp_path, law=law) as run, browser(tmp_path) as new_tab:
        tab = new_tab(run.address)
        tab.wait_for(RUNNING)
        (tmp_path / "fault").touch()
        tab.wait_for("!document.getElementById('fault').hidden", timeout=20.0)
        shown = tab.text("#fault")
        assert "Fault of knee, left" in shown and "A command is NaN or infinite" in shown
        assert "then start the run again" in shown
        assert run.end()[0] == 3
        tab.wait_for("document.getElementById('state').dataset.state === 'fault'")
        assert "FAULT at left/knee" in tab.evaluate("document.querySelector('#fault pre').textContent")


@pytest.mark.soak
def test_diagram_shows_values_at_its_ports_and_a_click_on_one_plots_it(opened):
    _, tab = opened
    tab.evaluate("document.getElementById('tab-plots').click()")
    tab.evaluate("drawing = document.getElementById('diagram').shadowRoot")
    ports = "[...drawing.querySelectorAll('[data-path=\"left/law\"] .signal')]"
    tab.evaluate(f"port = {ports}.find((it) => it.textContent.startsWith('torque'))")
    first = tab.wait_for("/^torque \\S+ N·m$/.test(port.textContent) && port.textContent")
    tab.wait_for(f"port.textContent !== {first!r}")
    wire = "drawing.querySelector('.line[data-signal=\"left/law.torque\"]')"
    tab.wait_for(f"Number({wire}.style.getPropertyValue('--pulse')) > 0")
    box = "document.querySelector('#list [data-path=\"left/law.torque\"] input')"
    assert (
        not tab.evaluate(f"{box}.checked")
        and tab.evaluate("port.getAttribute('aria-label')") == "plot torque of law, left"
    )
    tab.evaluate("port.dispatchEvent(new MouseEvent('click'))")
    assert tab.evaluate(f"{box}.checked && port.getAttribute('aria-pressed') === 'true'")
    tab.evaluate(
        "drawing.querySelector('.hit[data-signal=\"left/law.torque\"]').dispatchEvent(new MouseEvent('click'))"
    )
    assert not tab.evaluate(f"{box}.checked")
    with Diagram("chart", rate=100) as diagram:
        StateMachine(name="leg", states={"walking": {"states": {"stance": {}, "swing": {}}}, "seated": {}})
    for number, name in enumerate(("stance", "swing", "seated")):
        active = tab.evaluate(f"""(async () => {{
            const {{ DiagramView }} = await import("/diagram.js"), place = document.createElement("div");
            const tools = document.createElement("div");
            tools.innerHTML = "<button></button>".repeat(3);
            const view = new DiagramView(place, tools, () => {{}});
            view.build({json.dumps(svg(draw(diagram)))}, [{{ path: "leg.state", factor: 1, labels: [] }}]);
            view.show([{number}]);
            return [...place.shadowRoot.querySelectorAll(".active > .port")].map((it) => it.textContent);
        }})()""")
        assert active == [name]
    assert tab.problems == []


@pytest.mark.soak
def test_plots_draw_spikes_between_frames_and_the_average_stride(opened):
    _, tab = opened
    found = tab.evaluate("""(async () => {
        const { Plots } = await import("/plots.js");
        const list = document.createElement("ul"), filter = document.createElement("input");
        const made = new Plots(document.createElement("div"), list, filter);
        const signal = { block: "walk", shown: "m", factor: 1, dtype: "float" };
        const ports = ["height", "y"].map((port) => ({ ...signal, path: `walk.${port}`, port }));
        made.build({ signals: ports, phases: { "walk.y": "" } });
        for (let frame = 0; frame <= 90; frame += 1) {   // strides of 1 s with a height of 1, 2 and 3 m
            const time = frame / 30, values = [1 + Math.floor(time), time % 1];
            made.add(time, values, [frame === 40 ? 9 : values[0], values[1]], values);
        }
        const heights = [...made.columns[0].subarray(0, made.count)];
        return { count: made.count, spikes: heights.filter((value) => value === 9).length,
            mean: made.overlay(0, made.count - 40)[20] };
    })()""")
    assert (found["count"], found["spikes"]) == (1 + 3 * 90, 1)
    assert found["mean"] == pytest.approx(2.0, abs=0.3)


@pytest.mark.soak
def test_subject_sees_each_stride_beside_the_target_band_and_can_only_stop(tmp_path):
    with running(tmp_path, more=WALK) as run, browser(tmp_path) as new_tab:
        operates, tab = new_tab(run.address), new_tab(f"{run.address}subject")
        seen, value = {}, "document.querySelector('#value b').innerText"
        for word in ("▲ more", "✓ in the target", "▼ less"):
            seen[word] = tab.wait_for(f"document.getElementById('word').innerText === {word!r} && {value}")
        assert [float(value) for value in seen.values()] == pytest.approx([1.0, 1.2, 1.4], rel=0.03)
        assert tab.text("#name") == "Walk height" and "target 1.10 to 1.30 m" in tab.text("#goal")
        operates.wait_for("document.getElementById('operator').innerText === 'this page, 2 pages open'")
        for width in (390, 1920):
            tab.look(width)
            assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
        tab.evaluate("document.getElementById('stride').value = ''; document.querySelector('form').requestSubmit()")
        tab.wait_for(f"Number({value}) < 0.9")
        assert "stride=&low=1.1&high=1.3" in tab.evaluate("location.search")
        tab.press(" ", "Space")
        code, said = run.end()
        assert code == 0 and "stopped by page 2 of the panel" in said
        tab.wait_for("document.body.classList.contains('old')")
    assert_safely_stopped(run.files, (1, 2))


@pytest.mark.soak
def test_buttons_of_the_diagram_set_marks_with_their_notes(tmp_path):
    with running(tmp_path, more=WALK) as run, browser(tmp_path) as new_tab:
        tab = new_tab(run.address)
        for number, note in enumerate(("start", "uphill"), 1):
            tab.wait_for("document.querySelector('#marks button:enabled') !== null")
            tab.click(f"#marks button:nth-child({number})")
            tab.wait_for(f"document.getElementById('log').innerText.includes('Mark {number}: {note}')")
        tab.press(" ", "Space")
        assert run.end()[0] == 0
    notes = [event["text"] for event in run.files.sidecar["events"] if event["event"] == "note"]
    assert notes == ["start", "uphill"]
