"""The page, clicked and typed at in a real browser."""

import pytest

from graph.drawing import draw, page
from tests.graph.drawing.browser import browse, needs_browser
from tests.graph.drawing.diagrams import by_chance, leg, nested, walk
from tests.soaking import soaked

pytestmark = needs_browser

GEOMETRY = """
const shown = (item) => !item.closest(".hidden");
const inScene = (item) => {
  const r = item.getBoundingClientRect();
  const edges = [[r.left, view.x], [r.top, view.y], [r.right, view.x], [r.bottom, view.y]];
  return edges.map(([at, from]) => (at - from) / view.k);
};
const visible = (selector) => [...scene.querySelectorAll(selector)].filter(shown);
"""


@pytest.fixture
def ask(tmp_path):
    def ask(diagram, script, **options):
        return browse(page(draw(diagram)), GEOMETRY + script, tmp_path, **options)

    return ask


@pytest.mark.soak
def test_every_text_fits_into_its_box(ask):
    wide = ask(
        nested(),
        """
        return visible(".box").flatMap((box) => [...box.querySelectorAll("text")].filter((text) => {
          const edge = box.querySelector(".edge").getBBox(), own = text.getBBox();
          return own.x < edge.x || own.x + own.width > edge.x + edge.width
            || own.y < edge.y || own.y + own.height > edge.y + edge.height;
        }).map((text) => box.dataset.path + ": " + text.textContent));""",
    )
    assert wide == []


@pytest.mark.soak
def test_port_names_on_both_sides_do_not_overlap(ask):
    touching = ask(
        nested(),
        """
        const hit = (a, b) => a.x < b.x + b.width && b.x < a.x + a.width
          && a.y < b.y + b.height - 4 && b.y < a.y + a.height - 4;
        return visible(".box").flatMap((box) => {
          const texts = [...box.querySelectorAll("text")].map((text) => [text.textContent, text.getBBox()]);
          const touched = ([name, a], i) =>
            texts.slice(i + 1).filter(([, b]) => hit(a, b)).map(([other]) => `${name}, ${other}`);
          return texts.flatMap(touched).map((names) => `${box.dataset.path}: ${names}`);
        });""",
    )
    assert touching == []


def test_a_click_on_a_block_shows_its_docstring_ports_parameters_and_line(ask):
    told = ask(
        leg(),
        """
        find("box", "left/torque_limiter").dispatchEvent(new MouseEvent("click", { bubbles: true }));
        return { text: panel.innerText, hidden: panel.hidden, hash: decodeURIComponent(location.hash) };""",
    )
    assert not told["hidden"] and told["hash"] == "#left/torque_limiter"
    for words in (
        "TorqueLimiter",
        "Limiter of a torque and its rate of change",
        "bounds left/knee.torque_command",
        "from left/impedance.torque",
        "to left/knee.torque_command",
        "-12 to 12 N·m",
        "limit",
        "12 N·m",
        "200 N·m/s",
        "at least 0",
        "native",
        "diagrams.py:",
    ):
        assert words in told["text"], words


@pytest.mark.soak
def test_a_link_in_a_card_leads_to_the_block_at_the_other_end(ask):
    assert ask(
        leg(),
        """
        choose("left/torque_limiter");
        [...panel.querySelectorAll("a")].find((a) => a.textContent === "left/knee.torque_command").click();
        return [chosen, panel.querySelector("h2").textContent];""",
    ) == ["left/knee", "left/knee"]


@pytest.mark.soak
def test_escape_closes_the_card(ask):
    assert ask(
        leg(),
        """
        choose("left/knee");
        document.dispatchEvent(new KeyboardEvent("keydown", { key: "Escape", bubbles: true }));
        return [panel.hidden, location.hash];""",
    ) == [True, ""]


@pytest.mark.soak
def test_a_block_is_reached_by_its_address_and_by_the_keyboard(ask):
    assert ask(leg(), "return chosen;", address="#left%2Fknee") == "left/knee"
    assert ask(
        leg(),
        """
        const box = find("box", "left/knee");
        box.focus();
        box.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
        return [document.activeElement === box, chosen];""",
    ) == [True, "left/knee"]


def test_search_matches_name_type_and_port_and_enter_selects(ask):
    told = ask(
        leg(),
        """
        const list = (text) => {
          search.value = text;
          search.dispatchEvent(new Event("input"));
          return visible(".box.match").map((box) => box.dataset.path).sort();
        };
        const found = [list("knee"), list("TorqueLimiter"), list("velocity"), list("no such thing"), list("")];
        list("impedance");
        search.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
        return [...found, chosen, search.value];""",
    )
    assert told[:2] == [["left/knee", "left/knee=command"], ["left/torque_limiter"]]
    assert set(told[2]) >= {"left/knee", "left/impedance"} and told[3] == [] and told[4] == []
    assert told[5:] == ["left/impedance", ""]


@pytest.mark.soak
def test_a_folded_subsystem_hides_its_blocks_and_frees_their_space(ask):
    told = ask(
        leg(),
        """
        const before = goal.y(drawing.height);
        find("frame", "left").querySelector(".head").dispatchEvent(new MouseEvent("click", { bubbles: true }));
        const paths = visible(".box").map((box) => box.dataset.path);
        const folded = { boxes: paths, lines: visible(".line").length, height: goal.y(drawing.height) };
        find("frame", "left").querySelector(".head").dispatchEvent(new MouseEvent("click", { bubbles: true }));
        const boxes = visible(".box").length, lines = visible(".line").length;
        return { before, folded, after: goal.y(drawing.height), boxes, lines };""",
    )
    assert told["folded"]["boxes"] == ["csv_recorder"] and told["folded"]["lines"] == 0
    assert told["folded"]["height"] < 0.6 * told["before"] and told["after"] == told["before"]
    assert told["boxes"] == 6 and told["lines"] == 5


@pytest.mark.soak
def test_a_second_leg_is_folded_until_it_is_opened_and_names_its_signals(ask):
    told = ask(
        walk(),
        """
        const names = (path) => [...find("frame", path).querySelectorAll(".pin")].map((text) => text.textContent);
        const before = visible(".box").map((box) => box.dataset.path);
        choose("right/limiter");
        return { folded: before, open: [...folded], first: names("right"), second: names("right=2") };""",
    )
    assert "right/limiter" not in told["folded"] and {"left/limiter", "right/knee"} <= set(told["folded"])
    assert (told["open"], told["first"], told["second"]) == ([], ["knee.velocity"], ["both.y"])


@pytest.mark.parametrize("seed", soaked([3, 7, 11], but=[0]))
def test_folding_never_makes_boxes_overlap_or_detaches_lines(seed, ask):
    told = ask(
        by_chance(seed, size=50),
        """
        const wrong = [];
        let turn = 1;
        for (let round = 0; round < 12; round++) {
          for (const frame of drawing.frames) {
            turn = (turn * 48271) % 2147483647;
            if (turn % 3 === 0) folded.has(frame.path) ? folded.delete(frame.path) : folded.add(frame.path);
          }
          refold(null);
          const edges = [...visible(".box > .edge"), ...visible(".frame.folded > .edge")];
          const things = edges.map((item) => [item.parentNode.dataset.path, inScene(item)]);
          for (let i = 0; i < things.length; i++) for (let j = 0; j < i; j++) {
            const [a, one] = things[i], [b, other] = things[j];
            const apart = one[0] > other[2] - 2 || other[0] > one[2] - 2
              || one[1] > other[3] - 2 || other[1] > one[3] - 2;
            if (!apart) wrong.push(`${a} covers ${b}`);
          }
          for (const frame of visible(".frame.folded")) {
            const edge = frame.querySelector(".edge").getBBox();
            for (const pin of frame.querySelectorAll("text")) {
              const own = pin.getBBox();
              const out = own.x < edge.x || own.x + own.width > edge.x + edge.width + 1;
              if (own.width && out) wrong.push(`${frame.dataset.path}: ${pin.textContent} sticks out`);
            }
          }
          const ends = new Set();
          for (const box of visible(".box")) for (const dot of box.querySelectorAll(".dot")) {
            const at = box.transform.baseVal[0].matrix;
            ends.add(`${Math.round(at.e + +dot.getAttribute("cx"))} ${Math.round(at.f + +dot.getAttribute("cy"))}`);
          }
          const pins = drawing.frames.flatMap((frame) => frame.pins);
          pins.forEach((pin) => ends.add(`${Math.round(map.x(pin.x))} ${Math.round(map.y(pin.y))}`));
          for (const line of visible(".line")) {
            const end = line.getPointAtLength(line.getTotalLength());
            if (!ends.has(`${Math.round(end.x)} ${Math.round(end.y)}`))
              wrong.push(`${line.dataset.signal} ends nowhere`);
          }
        }
        return { wrong, frames: drawing.frames.length };""",
    )
    assert told["frames"] > 2 and told["wrong"] == []


@pytest.mark.soak
def test_selecting_a_block_unfolds_its_subsystem_and_scrolls_to_it(ask):
    told = ask(
        nested(),
        """
        foldAll(true);
        choose("left/hip/limiter", true);
        const seen = find("box", "left/hip/limiter").getBoundingClientRect();
        const inside = seen.left > 0 && seen.top > 0
          && seen.right < innerWidth - panel.offsetWidth && seen.bottom < innerHeight;
        return { folded: [...folded], inside };""",
    )
    assert (
        "left" not in told["folded"]
        and "left/hip" not in told["folded"]
        and "right" in told["folded"]
        and told["inside"]
    )


@pytest.mark.soak
def test_animated_and_immediate_folding_give_the_same_view(ask):
    script = """
        for (const shut of [true, false, true]) fold("left", shut);
        await wait(600);
        return [map.x(drawing.width), map.y(drawing.height)];"""
    assert ask(nested(), script, motion=True) == ask(nested(), script)


@pytest.mark.soak
def test_the_wheel_zooms_about_the_pointer_and_dragging_moves(ask):
    told = ask(
        leg(),
        """
        const under = (x, y) => [(x - view.x) / view.k, (y - view.y) / view.k];
        const before = under(500, 400), k = view.k;
        canvas.dispatchEvent(new WheelEvent("wheel", { deltaY: -300, clientX: 500, clientY: 400, cancelable: true }));
        const after = under(500, 400), zoomed = view.k / k, at = view.x;
        const pointer = (name, x) => new PointerEvent(name, { pointerId: 1, clientX: x, clientY: 300, bubbles: true });
        canvas.dispatchEvent(pointer("pointerdown", 300));
        window.dispatchEvent(pointer("pointermove", 380));
        window.dispatchEvent(pointer("pointerup", 380));
        const moved = view.x - at;
        window.dispatchEvent(pointer("pointermove", 500));
        return { before, after, zoomed, moved, later: view.x - at };""",
    )
    assert told["after"] == pytest.approx(told["before"], abs=1e-6) and told["zoomed"] > 1.3
    assert told["moved"] == pytest.approx(80.0) and told["later"] == pytest.approx(80.0)


@pytest.mark.soak
def test_dragging_across_a_block_does_not_open_its_card(ask):
    assert (
        ask(
            leg(),
            """
        const box = find("box", "left/knee");
        const pointer = (name, x) => new PointerEvent(name, { pointerId: 1, clientX: x, clientY: 300, bubbles: true });
        box.dispatchEvent(pointer("pointerdown", 300));
        window.dispatchEvent(pointer("pointermove", 340));
        window.dispatchEvent(pointer("pointerup", 340));
        box.dispatchEvent(new MouseEvent("click", { bubbles: true }));
        return panel.hidden;""",
        )
        is True
    )


@pytest.mark.soak
def test_pointing_at_a_line_lights_the_whole_signal(ask):
    lit = ask(
        leg(),
        """
        const line = scene.querySelector('.line[data-signal="left/butterworth.y"]');
        line.dispatchEvent(new PointerEvent("pointerenter"));
        const during = scene.querySelectorAll(".lit").length;
        line.dispatchEvent(new PointerEvent("pointerleave"));
        return [during, scene.querySelectorAll(".lit").length, line.querySelector("title").textContent];""",
    )
    assert lit[:2] == [1, 0] and lit[2].startswith("left/butterworth.y   rad/s")


def test_names_of_a_diagram_are_escaped_in_html(ask):
    name = "<img src onerror>"
    assert ask(
        leg(name), 'return [document.title, document.querySelectorAll("img").length, document.scripts.length];'
    ) == [name, 0, 3]
