"""The steps of `commission` for insoles and emergency stops: healthy ones agree, and each fault is named."""

import json
import os
import socket
import time
from types import SimpleNamespace

import numpy as np
import pytest

from runtime.robot.rig.records import records_of
from runtime.setup.commissioning.guided import buttons, insoles
from tests.runtime.runs import started, write
from tests.runtime.setup.commissioning.nodes import channel
from tests.runtime.terminals import Terminal


def loading(peak=700.0, air=10.0, begins=2.0, rolls=0.12, loaded_first=False, **shares):
    """Loading of a foot that is in the air, steps from heel to toes, and lifts."""
    time = np.arange(0.0, 8.0, 0.005)
    down = (time > begins) & (time < begins + 2.0)
    force = np.where(down != loaded_first, peak, air)
    forward = np.where(down, 0.13 + rolls * ((time - begins) / 2.0 - 0.5), np.nan)
    return insoles.Loading(force, forward, **{"lost": 0.0, "corrupt": 0.0, "dead": 0.0} | shares, first=100)


STILL = {"begins": 9.0}
CASES = {
    "healthy": ({}, {"loaded_first": True}, None),
    "healthy, loose frames": ({"lost": 0.01}, STILL, None),
    "exchanged": ({"loaded_first": True}, {}, "exchanged"),
    "only the other": (STILL, {}, "exchanged"),
    "reversed": ({"rolls": -0.12}, STILL, "reversed"),
    "drop-outs": ({"lost": 0.2}, STILL, "drop-outs"),
    "corrupt": ({"corrupt": 0.1}, STILL, "corrupt frames"),
    "dead": ({"dead": 0.1}, STILL, "dead cells"),
    "scale": ({"peak": 7000.0}, STILL, "scale of the insole"),
    "offset": ({"air": 150.0, "peak": 850.0}, STILL, "offset of the insole"),
}


@pytest.mark.parametrize("case", CASES)
def test_an_insole_that_is_stepped_on_is_compared_with_its_block(case):
    own, other, finding = CASES[case]
    result = insoles.load_of("left", {"left": loading(**own), "right": loading(**other)})
    assert [name for name, _ in result.findings] == ([] if finding is None else [finding]), result
    assert result.done


def test_an_insole_that_is_silent_or_was_not_loaded():
    assert [name for name, _ in insoles.load_of("left", {}).findings] == ["silent"]
    assert not insoles.load_of("left", {"left": loading(**STILL)}).done
    light = insoles.load_of("left", {"left": loading(peak=70.0)})
    assert not light.done and "60 N at most" in light.says[0]


def ended(status="ok"):
    outcome = SimpleNamespace(status=status, faulted=status != "ok", culprit="button", error=None)
    return SimpleNamespace(outcome=outcome, report=[status])


@pytest.mark.hazard("H9c")
@pytest.mark.parametrize(
    "released, pressed, again, finding",
    [
        ("ok", "e-stop", "ok", None),
        ("e-stop", None, None, "pressed"),
        ("no answer", None, None, "silent"),
        ("ok", "ok", "ok", "no stop"),
        ("ok", "silent", "ok", "lost when pressed"),
        ("ok", "e-stop", "e-stop", "not released"),
    ],
)
def test_a_button_that_does_not_stop_a_run_or_stops_it_unpressed_is_named(released, pressed, again, finding):
    runs = [None if status is None else ended(status) for status in (released, pressed, again)]
    result = buttons.press_of(SimpleNamespace(path="button"), *runs)
    assert [name for name, _ in result.findings] == ([] if finding is None else [finding])


ROBOT = '''
import json
from blocks.safety import EStopHeartbeat
from blocks.sensors.insole import Insole
from graph import Block, Diagram, Output, subsystem

FOLDER, PORTS, EXCHANGED = {folder!r}, {ports!r}, {exchanged!r}


class Hand(Block):
    """Whether the button is pressed, and the force on each insole, which moves from heel to toes."""

    pressed = Output("1", dtype=bool)
    left = Output("N")
    right = Output("N")
    centre = Output("m", shape=(2,))

    def reset(self):
        self.now, self.since = {{}}, 0.0

    def step(self, t, tick):
        if tick % 20 == 0:
            new = json.load(open(FOLDER + "/hand.json"))
            self.now, self.since = new, t if new != self.now else self.since
        forward = 0.05 + 0.15 * min(1.0, (t - self.since) / 2.0)
        return self.now.get("pressed", False), self.now.get("left", 0.0), self.now.get("right", 0.0), (forward, 0.0)


def build():
    with Diagram("worn", rate=200) as diagram:
        EStopHeartbeat(name="button")
        for side, port in PORTS.items():
            Insole(side=side, address=f"127.0.0.1:{{port}}", name=side)
    return diagram


def plant(robot):
    with Diagram("worn_plant", rate=1000) as plant:
        hand = Hand()
        robot["button"].emulator(name="emulated_button")(pressed=hand.pressed)
        for side in PORTS:
            force = getattr(hand, {{"left": "right", "right": "left"}}[side] if EXCHANGED else side)
            robot[side].emulator(name="emulated_" + side)(force=force, centre=hand.centre)
    return plant
'''


def free_ports():
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as two,
    ):
        one.bind(("127.0.0.1", 0))
        two.bind(("127.0.0.1", 0))
        return {"left": one.getsockname()[1], "right": two.getsockname()[1]}


@pytest.mark.soak
@pytest.mark.paced
@pytest.mark.parametrize("exchanged", [False, True])
def test_insoles_and_a_button_are_commissioned(tmp_path, exchanged):
    robot = write(tmp_path, ROBOT.format(folder=str(tmp_path), ports=free_ports(), exchanged=exchanged))
    rig = f'[bus.estop]\ninterface = "udp_multicast"\nchannel = "{channel(141 + exchanged)}"\n'
    rig = write(tmp_path, rig, "lab.toml")

    def hold(**what):
        (tmp_path / "hand.new").write_text(json.dumps(what))
        os.replace(tmp_path / "hand.new", tmp_path / "hand.json")

    hold()
    plant = started("emulate", robot, "--rig", rig, cwd=tmp_path)
    try:
        while "Ctrl-C ends it" not in (line := plant.stdout.readline()):
            assert line, plant.stderr.readlines()
        with Terminal() as terminal:
            terminal.run("commission", rig, robot, "--name", "E. Person", cwd=tmp_path)
            text, seen, then, side, end = "", 0, [], "", time.monotonic() + 90.0
            while terminal.process.poll() is None:
                assert time.monotonic() < end, text[-2000:]
                text += terminal.look()
                terminal.shown = b""
                while (stop := text.find("\n", seen)) >= 0:
                    line, seen = text[seen:stop], stop + 1
                    if "> " in line:
                        time.sleep(0.3)
                        hold()
                        os.write(terminal.master, b"\n")
                        side = line.split("foot of ")[1].split(",")[0] if "Lift the foot" in line else ""
                        then = [{side: 700.0}, {}] if side else [{"pressed": True}] if "and keep it" in line else []
                        due = time.monotonic() + 3.0
                if then and time.monotonic() > due:
                    hold(**then.pop(0))
                    due = time.monotonic() + 2.5
                time.sleep(0.02)
    finally:
        plant.kill()
        plant.communicate()
    records = records_of(rig)
    found = {path: [name for name, _ in record.findings] for path, record in records.items()}
    wrong = ["exchanged"] if exchanged else []
    assert found == {"button": [], "left": wrong, "right": wrong}, text[-3000:]
    assert {step.verdict for record in records.values() for step in record.steps.values()} <= {"agrees", "differs"}
