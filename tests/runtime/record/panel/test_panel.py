"""The panel of a run in a process of its own, without a browser: what it shows, stops, changes and survives."""

import os
import random
import shutil
import signal
import socket
import subprocess
import time
from contextlib import suppress

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

import runtime
from runtime.host.live.running import shared_state_of
from runtime.host.options import panel_address
from runtime.record.analysis.names import describe
from runtime.record.panel.pages import MESSAGE_RATE
from runtime.record.panel.server import MESSAGE_LIMIT, REFUSED_LIMIT
from tests.runtime.record.panel.panels import ROBOT, SWING, Page, running
from tests.runtime.runs import Files, assert_safely_stopped, descendant, started, write
from tests.soaking import soaked

GAIN = "left/law.gain"


def test_values_of_a_page_are_those_of_the_recording(tmp_path):
    with running(tmp_path) as run:
        page = run.page()
        page.until(lambda: page.frames and page.frames[-1][0] >= 200)
        page.send(do="stop")
        assert page.until_closed() == 1001
        code, said = run.end()
    assert code == 0 and "stopped by page 1 of the panel" in said
    trial = runtime.load(run.files.one(".mcap"))
    rows = {int(tick): place for place, tick in enumerate(trial.tick)}
    seen = [frame for frame in page.frames if frame[0] in rows]
    assert len({tick for tick, _, _ in seen}) > 10
    for place, described in enumerate(page.hello["signals"]):
        recorded = trial[described["path"]]
        assert [values[place] for _, _, values in seen] == [float(recorded[rows[tick]]) for tick, _, _ in seen]
    assert page.status["complete"] and page.status["recording"]["name"] == run.files.one(".mcap").stem


@pytest.mark.hazard("H9f")
@pytest.mark.parametrize("first", soaked([True, False], but=[1]))
def test_every_page_stops_the_run_and_it_ends_with_its_safe_stop(tmp_path, first):
    with running(tmp_path) as run:
        pages = [run.page(), run.page()]
        pages[0].until(lambda: pages[0].frames and pages[0].frames[-1][0] > 10)
        stops = pages[0 if first else 1]
        stops.send(do="stop")
        code, _ = run.end()
    assert code == 0
    assert_safely_stopped(run.files, (1, 2))
    assert [event for event in run.files.sidecar["events"] if event["event"] == "stop"][0]["by"] == stops.hello["page"]


def test_operator_changes_parameters_inside_their_bounds_and_sets_marks(tmp_path):
    with running(tmp_path) as run:
        page = run.page()
        index = page.index(GAIN)
        assert page.ask("set", changes=[[index, 2.0]])["taken"]
        page.until(lambda: page.status["live"][index] == [2.0, 2.0])
        assert "out of bounds" in page.ask("set", changes=[[index, 3.5]])["text"]
        assert "no such" in page.ask("set", changes=[[99, 1.0]])["text"]
        assert page.ask("mark")["number"] == 1
        page.send(do="stop")
        page.until_closed()
        run.end()
    events = [{key: event[key] for key in ("event", "by")} for event in run.files.sidecar["events"] if "by" in event]
    assert events == [{"event": name, "by": page.hello["page"]} for name in ("set", "mark", "stop")]
    assert [event["event"] for event in page.events][:2] == ["set", "mark"]


@pytest.mark.soak
def test_note_on_a_mark_is_recorded_in_one_line_and_shown_on_every_page(tmp_path):
    with running(tmp_path) as run:
        page, other = run.page(), run.page()
        assert page.ask("mark", note="new\x1b[31m shoes\n<b>size 43</b> ")["number"] == 1
        [shown] = other.until(lambda: [event for event in other.events if event["event"] == "note"])
        page.send(do="mark", id=1, note="x" * 201)
        page.until(lambda: page.status["refused"] == 1)
        page.ask("mark", note="at the end")
        page.send(do="stop")
        assert run.end()[0] == 0
    notes = [event for event in run.files.sidecar["events"] if event["event"] == "note"]
    marks = [event for event in run.files.sidecar["events"] if event["event"] == "mark"]
    assert [note["text"] for note in notes] == ["new [31m shoes <b>size 43</b>", "at the end"]
    assert [(note["number"], note["tick"]) for note in notes] == [(mark["number"], mark["tick"]) for mark in marks]
    assert shown["text"] == notes[0]["text"]
    assert [event["event"] for event in runtime.load(run.files.one(".mcap")).events].count("note") == 2


@pytest.mark.soak
def test_changes_of_three_pages_in_turn_are_all_taken_and_recorded(tmp_path):
    with running(tmp_path) as run:
        pages, wanted = [run.page() for _ in range(3)], []
        index = pages[0].index(GAIN)
        for turn in range(6):
            page = pages[turn % 3]
            page.send(do="operate", take=True)
            for number in range(20):
                wanted.append(1.0 + 0.01 * turn + 0.001 * number)
                page.send(do="set", id=100 * turn + number, changes=[[index, wanted[-1]]])
            page.until(lambda: 100 * turn + 19 in page.answers and len(page.answers) == 20 * (1 + turn // 3))
        assert all(answer["taken"] for page in pages for answer in page.answers.values())
        pages[2].send(do="stop")
        assert run.end()[0] == 0
    assert [event["value"] for event in run.files.sidecar["events"] if event["event"] == "set"] == wanted


@pytest.mark.soak
def test_pages_that_leave_before_the_answer_do_not_fill_the_mailbox(tmp_path):
    with running(tmp_path, "--rate", "20") as run:
        for _ in range(40):
            page = run.page()
            page.send(do="operate", take=True)
            for number in range(3):
                page.send(do="set", id=number, changes=[[page.index(GAIN), 2.0]])
            page.socket.socket.close()  # as a browser that is killed
        page = run.page()
        page.send(do="operate", take=True)
        assert page.ask("set", changes=[[page.index(GAIN), 0.5]])["taken"]


@pytest.mark.timing
def test_stop_of_a_page_begins_within_20_ms(tmp_path):
    times = []
    for _ in range(3):
        with running(tmp_path) as run:
            page, shared = run.page(), shared_state_of(run.process.pid)
            page.until(lambda: page.frames and page.frames[-1][0] > 20)
            began = time.monotonic()
            page.send(do="stop")
            while shared.state == "running":
                time.sleep(1e-4)
            times.append(time.monotonic() - began)
            run.end()
        shutil.rmtree(run.files.folder)
    assert sorted(times)[1] < 0.02


@pytest.mark.hazard("H1k")
def test_one_page_operates_at_a_time_and_each_page_shows_which(tmp_path):
    with running(tmp_path) as run:
        first, second = run.page(), run.page()
        order = {"do": "set", "id": 1, "changes": [[first.index(GAIN), 0.5]]}
        second.send(**order)
        second.until(lambda: second.status["refused"] == 1)
        second.send(do="operate", take=True)
        for page in (first, second):
            page.until(lambda: [each["operates"] for each in page.status["pages"]] == [False, True])
        second.send(**order)
        assert second.until(lambda: second.answers.get(1))["taken"]
        second.socket.close()
        first.until(lambda: [each["operates"] for each in first.status["pages"]] == [False])


@pytest.mark.hazard("H4g")
def test_no_page_arms_a_drive(tmp_path):
    with running(tmp_path) as run:
        page = run.page()
        for value in (0.0, 1.0):
            answer = page.ask("set", changes=[[page.index("left/knee.disabled"), value]])
            assert not answer["taken"] and "never arms" in answer["text"]
        for order in ("confirm", "rearm", "arm"):
            page.send(do=order)
        page.until(lambda: page.status["refused"] == 3)


@pytest.mark.hazard("H1k")
def test_page_of_the_subject_may_stop_the_run_and_do_nothing_else(tmp_path):
    with running(tmp_path) as run:
        subject = run.page(place="/watching")
        assert subject.hello["role"] == "view"
        for order in (
            {"do": "operate", "take": True},
            {"do": "mark", "id": 1},
            {"do": "set", "id": 2, "changes": [[subject.index(GAIN), 0.5]]},
        ):
            subject.send(**order)
        subject.until(lambda: subject.status["refused"] == 3)
        assert [page["operates"] for page in subject.status["pages"]] == [False]
        subject.send(do="stop")
        assert run.end()[0] == 0
    assert [event["event"] for event in run.files.sidecar["events"] if "by" in event] == ["stop"]


# Hostile pages

HOSTILE = [
    "",
    "{",
    "[]",
    "null",
    "stop",
    '{"do": "stop", "more": 1}',
    '{"do": "set", "id": 1}',
    '{"do": "set", "id": 1, "changes": [[0, "x"]]}',
    '{"do": "set", "id": 1, "changes": [[0.5, 1]]}',
    '{"do": "set", "id": 1, "changes": [[0, 1e999]]}',
    '{"do": "set", "id": 1, "changes": [[0, NaN]]}',
    '{"do": "fly"}',
    '{"do": "seen"}',
    '{"do": "seen", "at": 1}',
    '{"do": "seen", "at": -1e300}',
    '{"do": "seen", "at": "1"}',
    '{"do": "operate", "take": 1}',
    "[" * 2000,
    "\ud7ff\x00" * 50,
    b"\x00" * 100,
]


@pytest.mark.hazard("H1k")
def test_five_thousand_hostile_messages_change_nothing(tmp_path):
    with running(tmp_path) as run:
        first, sent = run.page(), 0
        before = first.status["live"]
        first.socket.close()  # one that reads nothing for seconds would be closed
        while sent < 5000:
            bad = next_page(run)
            try:
                for _ in range(REFUSED_LIMIT * 4):
                    bad.socket.send(HOSTILE[sent % len(HOSTILE)])
                    sent += 1
            except ConnectionClosed:
                pass
            bad.socket.close()
        good = next_page(run)
        good.until(lambda: good.status["refused"] >= REFUSED_LIMIT)
        assert good.status["state"] == "running" and good.status["live"] == before
        good.send(do="stop")
        assert run.end()[0] == 0
    assert [event for event in run.files.sidecar["events"] if event["event"] == "set"] == []


def next_page(run):
    """A page, once the pages before are closed."""
    while True:
        with suppress(InvalidStatus):
            return run.page()
        time.sleep(0.02)


@pytest.mark.soak
def test_message_that_is_too_long_closes_its_page_only(tmp_path):
    with running(tmp_path) as run:
        good, bad = run.page(), run.page()
        bad.socket.send("x" * (MESSAGE_LIMIT + 1))
        assert bad.until_closed() == 1009
        good.until(lambda: len(good.status["pages"]) == 1)


@pytest.mark.soak
def test_stalled_page_delays_no_other(tmp_path):
    with running(tmp_path) as run:
        stalled, good = run.page(), run.page()
        assert stalled.socket is not None  # it reads nothing from here on
        until = time.monotonic() + 2.0
        count = len(good.frames)
        while time.monotonic() < until:
            good.take()
        assert len(good.frames) - count > 30


@pytest.mark.hazard("H15c")
@pytest.mark.parametrize(
    "headers",
    soaked(
        [{"origin": None}, {"origin": "http://evil.example"}, {"origin": "null"}, {"origin": "http://127.0.0.1:1"}],
        but=[1, 3],
    ),
)
def test_page_of_another_site_cannot_connect(tmp_path, headers):
    with running(tmp_path) as run:
        with pytest.raises(InvalidStatus) as refused:
            run.page(**headers)
        assert refused.value.response.status_code == 403


def test_name_that_resolves_to_this_computer_is_no_proof(tmp_path):
    with running(tmp_path) as run:
        port = int(run.address.rstrip("/").rpartition(":")[2])
        name = f"rebound.example:{port}"
        with pytest.raises(InvalidStatus) as refused, socket.create_connection(("127.0.0.1", port)) as reached:
            connect(f"ws://{name}/socket", origin=f"http://{name}", sock=reached).__enter__()
        assert refused.value.response.status_code == 403


FETCH = """
import sys, urllib.error, urllib.request
try:
    urllib.request.urlopen(sys.argv[1])
except urllib.error.HTTPError as error:
    print(error.code)
"""


@pytest.mark.skipif(os.getuid() != 0, reason="only root can become another account")
def test_another_account_of_this_computer_sees_nothing(tmp_path):
    with running(tmp_path) as run:
        command = ["/usr/bin/env", "python3", "-c", FETCH, run.address]
        found = subprocess.run(command, user=65534, capture_output=True, text=True, cwd="/", env={"PATH": os.defpath})
    assert found.stdout == "403\n", found.stderr


@pytest.mark.hazard("H15c")
def test_another_address_needs_a_token_and_a_viewer_only_stops(tmp_path):
    with running(tmp_path, host="0.0.0.0") as run:
        assert set(run.addresses) == {"view", "operate"}
        base = run.addresses["view"].partition("#")[0]
        for wrong in ("x", "0" * 20):
            with pytest.raises(ConnectionClosed):
                Page.open(f"{base}#{wrong}")
        viewer, operator = run.page("view"), run.page("operate")
        assert (viewer.hello["role"], operator.hello["role"]) == ("view", "operate")
        viewer.send(do="operate", take=True)
        viewer.until(lambda: viewer.status["refused"] == 3)  # two wrong tokens, and this
        assert operator.ask("set", changes=[[operator.index(GAIN), 0.5]])["taken"]
        viewer.send(do="stop")
        code, said = run.end()
    assert code == 0 and f"stopped by {viewer.hello['page']} of the panel" in said
    tokens = [address.partition("#")[2] for address in run.addresses.values()]
    recorded = b"".join(path.read_bytes() for path in run.files.folder.iterdir())
    assert all(token.encode() not in recorded for token in tokens)


# The end of a panel


@pytest.mark.hazard("H9f")
def test_panel_that_dies_is_started_once_more_and_the_run_continues_without_it(tmp_path):
    with running(tmp_path) as run:
        for expected in ("started once more", "died again"):
            page = run.page()
            page.until(lambda: page.frames)
            os.kill(descendant(run.process.pid, "tickwork-panel"), signal.SIGKILL)
            run.await_line(expected)
            if expected == "started once more":
                run.await_line("panel: http://")
        assert descendant(run.process.pid, "tickwork-panel") is None
        run.process.send_signal(signal.SIGINT)
        code, said = run.end()
    assert code == 130 and "its process died again" in said
    assert run.files.sidecar["ticks"] > 100 and run.files.sidecar["dropped"] == 0


def test_panel_that_is_paused_holds_up_neither_run_nor_recording(tmp_path):
    with running(tmp_path, "--duration", "2") as run:
        os.kill(descendant(run.process.pid, "tickwork-panel"), signal.SIGSTOP)
        code, _ = run.end()
    assert code == 0 and run.files.sidecar["dropped"] == 0


@pytest.mark.soak
def test_panel_serves_the_parts_after_the_death_of_the_writer(tmp_path):
    with running(tmp_path) as run:
        before = run.page()
        os.kill(descendant(run.process.pid, "tickwork-record"), signal.SIGKILL)
        run.await_line("panel: http://")
        page = run.page()
        page.until(lambda: page.frames)
        assert page.hello["run"] == before.hello["run"]
        page.send(do="stop")
        assert run.end()[0] in (0, 4)


@pytest.mark.soak
def test_fault_is_shown_with_its_report(tmp_path):
    with running(tmp_path, law="return math.nan if t > 1.5 else 0.0") as run:
        page = run.page()
        page.until_closed()
        assert run.end()[0] == 3
    [end] = [event for event in page.events if event["event"] == "end"]
    assert end["status"] == "not finite" and any("FAULT at" in line for line in end["report"])


# Options, names


@pytest.mark.soak
def test_address_of_another_process_is_refused(tmp_path, command_line):
    with running(tmp_path) as run:
        port = run.address.rstrip("/").rpartition(":")[2]
        said = command_line.refused(run.folder / "robot.py", "--panel", port)
    assert f"cannot listen on 127.0.0.1: port {port} is in use" in said


@pytest.mark.soak
def test_page_on_the_loopback_address_of_ipv6(tmp_path):
    with running(tmp_path, host="[::1]") as run:
        assert run.address.startswith("http://[::1]:")
        assert run.page().status["state"] in ("init", "arming", "running")


@pytest.mark.parametrize(
    "text, expected",
    [
        ("", ("127.0.0.1", 0)),
        ("8080", ("127.0.0.1", 8080)),
        ("192.168.1.5", ("192.168.1.5", 0)),
        ("192.168.1.5:8080", ("192.168.1.5", 8080)),
        ("[::1]:8080", ("::1", 8080)),
        ("::1", ("::1", 0)),
        ("[fe80::1]", ("fe80::1", 0)),
        (":8080", ("127.0.0.1", 8080)),
    ],
)
def test_address_of_the_panel(text, expected):
    assert panel_address(text) == expected


def test_virtual_time_has_no_page(command_line):
    assert "--panel and --fast exclude each other" in command_line.refused(
        "robot.py", "--panel", "8080", "--fast", "--duration", "1"
    )


def test_lost_page_is_a_stop_for_one_panel_of_a_run_that_has_one(command_line):
    head = "from blocks.sinks import Panel\nfrom graph import Diagram\n"
    robot = "with Diagram('robot', rate=200) as diagram:\n    "
    write(command_line.folder, f"from blocks.sources import Constant\n{head}{robot}Constant(0.0)()")
    assert "the run has no page: add --panel" in command_line.refused("robot.py", "--panel-lost", "stop")
    write(command_line.folder, head + robot + "; ".join(["Panel(lost='stop')"] * 2))
    assert 'panel and panel_2 have lost="stop"' in command_line.refused("robot.py")
    assert 'panel and panel_2 have lost="stop"' in command_line.refused("check", "robot.py")


def test_names_and_units_are_those_of_people():
    entries = [
        {"path": "left/knee.position", "unit": "rad"},
        {"path": "right/gait_phase.rms_torque", "unit": "N·m"},
        *({"path": f"imu.accel[{axis}]", "unit": "m/s²"} for axis in range(3)),
    ]
    found = [(each["block"], each["port"], each["shown"]) for each in describe(entries)]
    assert found == [
        ("knee, left", "position", "°"),
        ("gait phase, right", "RMS torque", "N·m"),
        *(("IMU", f"accel {axis}", "m/s²") for axis in "xyz"),
    ]
    assert describe(entries)[0]["factor"] == pytest.approx(57.29578)


@pytest.mark.soak
@pytest.mark.hazard("H1k")
def test_ten_thousand_changes_of_three_pages_are_applied_in_their_order_and_inside_their_bounds(tmp_path):
    values, rounds, each = random.Random(1), 100, 56
    asked = []
    with running(tmp_path) as run:
        pages = [run.page() for _ in range(3)]
        both = [pages[0].index(f"{side}/law.gain") for side in ("left", "right")]
        began = time.monotonic()
        for number in range(rounds):
            page = pages[number % 3]
            time.sleep(max(0.0, began + number * (each + 1) / (3 * MESSAGE_RATE) - time.monotonic()))
            page.send(do="operate", take=True)
            page.until(
                lambda: {"name": page.hello["page"], "role": "operate", "operates": True} in page.status["pages"]
            )
            first = each * number
            for place in range(first, first + each):
                value = values.uniform(0.0, 3.0) if place % 10 else values.choice([-0.001, 3.001, 1e300])
                page.send(do="set", id=place, changes=[[index, value] for index in both])
                asked.append((page.hello["page"], value))
            page.until(lambda: page.answers.keys() >= set(range(first, first + each)))
        answers = [pages[place // each % 3].answers[place] for place in range(len(asked))]
        pages[0].send(do="stop")
        assert run.end()[0] == 0
    taken = [one for one, answer in zip(asked, answers) if answer["taken"]]
    assert 2 * len(taken) > 10_000 and all(0.0 <= value <= 3.0 for _, value in taken)
    assert all("out of bounds" in answer["text"] for answer in answers if not answer["taken"])
    assert len(asked) - len(taken) == len(asked) // 10
    for side in ("left", "right"):
        events = [each for each in run.files.sidecar["events"] if each.get("path") == f"{side}/law.gain"]
        assert [(event["by"], event["value"]) for event in events] == taken
        assert all(0.0 <= event["value"] <= 3.0 for event in events)
    trial = runtime.load(run.files.one(".mcap"))
    assert float(abs(trial["left/law.torque"]).max()) <= 3.0


CHUNKS, CHUNK = 8, 10.0  # runs of each kind, in turn; s


@pytest.mark.soak
@pytest.mark.timing
def test_lateness_of_the_loop_without_a_panel_and_with_five_pages_one_of_them_stalled(tmp_path):
    late = {"no panel": [], "five pages": []}
    for number in range(CHUNKS):
        for kind, found in late.items():
            folder = tmp_path / f"{kind} {number}"
            folder.mkdir()
            options = "--record", "recordings", "--duration", str(CHUNK)
            if kind == "no panel":
                with started(write(folder, ROBOT.format(law=SWING)), *options, cwd=folder) as process:
                    assert process.communicate(timeout=60) and process.returncode == 0
            else:
                with running(folder, *options[2:]) as run:
                    pages = [run.page() for _ in range(5)]  # the last one takes nothing
                    while pages[0].status["state"] == "running":
                        with suppress(ConnectionClosed):
                            for page in pages[:4]:
                                page.take()
                    assert run.end()[0] == 0
            statistics = Files(folder / "recordings").sidecar["statistics"]
            assert statistics["dropped"] == 0
            found.append(1e6 * statistics["lateness"]["p99"])
    for kind, found in late.items():
        found.sort()
        print(f"{kind}: p99 {found[CHUNKS // 2]:.0f} µs median of {CHUNKS} runs, {found[0]:.0f} to {found[-1]:.0f}")
