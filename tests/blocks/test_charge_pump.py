"""The charge pump: its frames, the relay that they hold, and that whatever ends a run ends them.

In virtual time unless stated otherwise.
"""

import binascii
import shutil
import subprocess
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.actuators.mit_frames import ENABLE
from blocks.charge_pump import ChargePump, EmulatedChargePump
from blocks.limiters import TorqueLimiter
from blocks.logic import Not
from blocks.models import Limb
from blocks.safety import EmergencyStop, Rearm
from cext.memory.shared_state import SharedState
from graph import Block, Diagram, DiagramError, Output, compile
from runtime.record.report.failure_coverage import coverage, in_words
from runtime.session.check.report import check
from runtime.session.check.text import report_lines
from tests.blocks.actuators.wire import MALFORMED, Wired
from tests.blocks.running import player
from tests.cext.rigs import STOP, Rig
from tests.runtime.runs import ROOT, write

RATE, PERIOD = 200, 5_000_000  # Hz, ns
HOLD, START_UP = 0.1, 0.2  # s
NOTED, BYTES, LOST, BACK = 2, 0, 1, 2
MESSAGES = Wired(EmulatedChargePump, messages=1)


def message(number):
    """What goes to a microcontroller, made independently of the kernel: counter, CRC-16/CCITT-FALSE, stuffed by
    COBS.
    """
    plain = bytes([number]) + binascii.crc_hqx(bytes([number]), 0xFFFF).to_bytes(2, "little")
    return b"".join(bytes([len(part) + 1]) + part for part in plain.split(b"\0")) + b"\0"


# Frames


def test_on_a_gpio_line_every_frame_toggles_the_level():
    pump = Wired(ChargePump)
    said = []
    for _ in range(600):
        said += pump.say()
    assert said == [(BYTES, b"\1"), (BYTES, b"\0")] * 300 and pump["changes"] == 600.0


def test_to_a_microcontroller_every_message_has_the_next_number():
    pump = Wired(ChargePump, port="/dev/ttyACM0")
    assert [pump.say() for _ in range(600)] == [[(BYTES, message(number % 256))] for number in range(1, 601)]
    assert all(len(message(number)) == 5 for number in range(256))


@pytest.mark.parametrize(
    "parameters, line",
    [({}, "gpio"), ({"pin": "GPIO4"}, "gpio"), ({"port": "/dev/ttyACM0"}, "serial"), ({"serial": "12"}, "serial")],
)
def test_rig_selects_type_of_line(parameters, line):
    assert ChargePump(name="pump", **parameters).line == line


def test_a_gpio_line_and_a_microcontroller_at_once_are_refused():
    with pytest.raises(DiagramError, match="the output is either a GPIO line or a microcontroller"):
        ChargePump(name="pump", pin="GPIO4", port="/dev/ttyACM0")


def pump_diagram(rate=RATE, **parameters):
    with Diagram("robot", rate=rate) as robot:
        CubeMars("AK80-9", bus="legs", can_id=7, name="knee")(torque_command=0.0)
        ChargePump(name="pump", **parameters)
    return robot


@pytest.mark.parametrize(
    "rate, parameters, words",
    [
        (20, {"hold": 0.2}, "hold 0.2 s: the relay must hold for longer than the 0.25 s"),
        (1000, {"port": "/dev/ttyS0", "baudrate": 57600}, "use 87% of the line"),
        # a safe stop has rounds of 5 ms
        (50, {"port": "/dev/ttyS0", "baudrate": 9600, "hold": 0.5}, "use 104% of the line"),
        (200, {"protects": ("kneee",)}, "no actuator and no bus of actuators named 'kneee'"),
        (200, {"protects": ("pump",)}, "no actuator and no bus of actuators named 'pump'"),
    ],
)
def test_ineffective_relay_settings_are_refused(rate, parameters, words):
    with pytest.raises(DiagramError) as caught:
        compile(pump_diagram(rate, **parameters))
    assert words in str(caught.value)


# The relay


def test_the_relay_holds_only_for_its_time_after_each_level_change():
    relay = Wired(EmulatedChargePump, hold=0.1)

    def holds_after(seconds, data=None):
        relay.arena[0] += seconds
        if data is not None:
            assert relay.hear(BYTES, data) == NOTED
        relay.step()
        return relay["holds"]

    assert [holds_after(0.01, b"\1") for _ in range(30)] == [0.0] * 30  # a level that never changes
    assert [holds_after(0.09, level) for level in (b"\0", b"\1")] == [1.0, 1.0]
    assert (holds_after(0.09), holds_after(0.02), relay["changes"]) == (1.0, 0.0, 2.0)


def test_a_split_message_counts_once_and_a_corrupt_one_not_at_all():
    relay = Wired(EmulatedChargePump, messages=1)
    stream = b"".join(map(message, (255, 0, 0, 1)))
    for byte in stream:
        relay.hear(BYTES, bytes([byte]))
    assert relay["changes"] == 2.0  # 0 follows 255, its repetition is none, 1 follows
    broken = bytearray(message(2))
    broken[1] ^= 1
    assert relay.hear(BYTES, bytes(broken)) == MALFORMED and relay.hear(BYTES, bytes([7] * 40 + [0])) == MALFORMED
    assert relay["changes"] == 2.0 and relay.hear(BYTES, message(9)) == NOTED and relay["changes"] == 3.0


ARDUINO = r"""
#include <cstdint>
#include <cstdio>
#include <cstring>
#define HIGH 1
#define LOW 0
#define OUTPUT 1
static unsigned long now = 0;
static int said = 0;
inline void pinMode(int, int) {}
inline unsigned long micros() { return now; }
inline void digitalWrite(int pin, int value) { if (said) printf("%lu %d %d\n", now, pin, value); }
static uint8_t waiting[4096];
static size_t first = 0, last = 0;
struct {
    void begin(long) {}
    int available() { return last - first; }
    int read() { return waiting[first++]; }
} Serial;
"""
MAIN = """
#include "sketch.ino"
int main() {                                    // each line of the input: at which microsecond, which bytes
    unsigned long until;
    char digits[4096];
    setup();
    said = 1;
    while (scanf("%lu %4095s", &until, digits) == 2) {
        for (; now < until; now += 100) loop();
        for (const char *at = digits; at[0] != '-' && at[0]; at += 2) {
            unsigned byte; sscanf(at, "%2x", &byte); waiting[last++] = byte;
        }
        loop();
    }
}
"""


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs a C++ compiler")
def test_the_documented_sketch_toggles_its_pin_only_for_new_numbers(tmp_path):
    """Its own text, compiled with the few functions of an Arduino that it calls."""
    (tmp_path / "Arduino.h").write_text(ARDUINO)
    (tmp_path / "sketch.ino").write_text((ROOT / "docs/sketches/charge_pump.ino").read_text())
    (tmp_path / "main.cpp").write_text(MAIN)
    subprocess.run(
        ["g++", "-Wall", "-Werror", "-I", tmp_path, tmp_path / "main.cpp", "-o", tmp_path / "sketch"],
        check=True,
        timeout=60,
    )

    def edges(*lines):
        text = "".join(f"{when} {data.hex() or '-'}\n" for when, data in lines)
        out = subprocess.run([tmp_path / "sketch"], input=text, capture_output=True, text=True, timeout=10).stdout
        return [tuple(map(int, line.split())) for line in out.splitlines()]

    every = [(5000 * number, message(number % 256)) for number in range(1, 301)]
    assert edges(*every) == [(5000 * number, 4, number % 2) for number in range(1, 301)]
    # a number that stands still
    assert edges(*((5000 * count, message(7)) for count in range(1, 30))) == [(5000, 4, 1), (55100, 4, 0)]
    assert edges((1000, message(1)), (100_000, b"")) == [(1000, 4, 1), (51100, 4, 0)]  # silence
    broken = bytes([4, 1, 0x11, 0x22, 0])
    assert edges((1000, broken), (2000, bytes([9] * 30 + [0])), (3000, b"\xff\1\2\3\0"), (4000, message(1))) == [
        (4000, 4, 1)
    ]
    whole = message(1) + message(2) + message(3)
    assert edges(*((1000 + 100 * place, whole[place : place + 1]) for place in range(len(whole)))) == [
        (1400, 4, 1),
        (1900, 4, 0),
        (2400, 4, 1),
    ]


@given(chunks=st.lists(st.binary(max_size=64), max_size=8), number=st.integers(0, 255))
def test_the_emulated_microcontroller_accepts_the_next_message_after_garbage(chunks, number):
    relay = Wired.again(MESSAGES)
    for chunk in chunks:
        relay.hear(BYTES, chunk)
    before = relay["changes"]
    for each in (number, (number + 1) % 256):
        relay.hear(BYTES, b"\0" + message(each))
    assert relay["changes"] in (before + 1.0, before + 2.0)


# What ends the toggling


class Then(Block):
    """2 N·m; calls something at a tick."""

    y = Output("N·m")

    def __init__(self, action, tick=40, **options):
        self.action, self.when = action, tick
        super().__init__(**options)

    def step(self, tick):
        if tick == self.when:
            self.action()
        return 2.0


def torn():
    raise RuntimeError("torn")


def robot_with_pump(action=lambda: None, more=lambda: None, **knee):
    """A knee whose power goes through the relay of a charge pump, and what happens in tick 40."""
    with Diagram("robot", rate=RATE) as robot:
        drive = CubeMars("AK10-9-V2.0", bus="legs", can_id=1, name="knee", **knee)
        drive(torque_command=TorqueLimiter(limit=5.0)(Then(action, name="law").y))
        ChargePump(name="pump", hold=HOLD, start_up=START_UP)
        more()
    return robot


def plant_with_relay(robot, lost=(False,), booting=0.0):
    """The drive has power while the relay holds, and does not reply in the first `booting` s."""
    with Diagram("plant", rate=5 * RATE) as plant:
        relay = robot["pump"].emulator(name="relay")
        relay(lost=player(lost, "1", bool))
        drive = EmulatedCubeMars.of(robot["knee"], name="drive")
        booting = player([True] * round(5 * RATE * booting) + [False], "1", bool)
        limb = Limb(inertia=0.1, damping=0.5, stiffness=0.0, reflex=0.0, name="limb")
        limb(torque=drive.torque)
        drive(position=limb.position, velocity=limb.velocity, power_lost=Not()(relay.holds), silent=booting)
    return plant


def rig_of(action=lambda: None, more=lambda: None, plant=True, options=None, **knee):
    robot = robot_with_pump(action, more, **knee)
    return Rig(robot, plant_with_relay(robot) if plant else None, **(options or {}))


def pulses(rig):
    """(time in ns, level) of every frame of the pump."""
    bus = rig.schedule.buses.index("pump")
    return [(frame.time, frame.data[0]) for frame in rig.frames if frame.sent and frame.bus == bus]


def stop_of(rig):
    """ns of the first frame of the safe stop."""
    return next(frame.time for frame in rig.frames if frame.sent and frame.id == 1 and frame.data == STOP[-1])


def assert_toggled(found, missing=0):
    """One change in every period; `missing` periods have none, never two in a row."""
    assert [level for _, level in found] == [(found[0][1] + place) % 2 for place in range(len(found))]
    gaps = [after - before for (before, _), (after, _) in zip(found, found[1:])]
    assert gaps.count(2 * PERIOD) == missing and gaps.count(PERIOD) == len(gaps) - missing


def test_drives_are_armed_after_the_relay_has_closed():
    rig = rig_of()
    assert rig.run(100).status == "ok"
    first_command = next(frame for frame in rig.frames if frame.sent and frame.id == 1)
    assert first_command.data == ENABLE and first_command.time == round(START_UP * 1e9)
    found = pulses(rig)
    assert found[0][0] == 0 and found[-1][0] == rig.shared.first_tick + 99 * PERIOD
    assert_toggled(found)
    assert list(rig["pump.changes"]) == [*range(len(found) - 99, len(found) + 1)] and not any(rig["pump.fault"])
    assert len(rig.commands()) == 100


def test_the_relay_holds_during_confirmation():
    rig = rig_of()
    seen = []
    outcome = rig.run(20, answered=lambda: seen.append(rig.shared.state), confirm=False)
    assert outcome.status == "ok" and seen
    assert_toggled(pulses(rig))


@pytest.mark.parametrize("answered", [None, lambda: None], ids=["without an operator", "with one"])
def test_the_relay_holds_while_a_drive_takes_long_to_reply(answered):
    """Longer than the relay holds without a pulse."""
    robot = robot_with_pump()
    rig = Rig(robot, plant_with_relay(robot, booting=0.5))
    assert rig.run(20, answered=answered).status == "ok"
    assert rig.shared.first_tick > (START_UP + 2.0 * HOLD) * 1e9
    assert_toggled(pulses(rig))


@pytest.mark.parametrize(
    "what", ["an exception", "an emergency stop", "the fence of another process", "NaN", "the end"]
)
def test_no_pulse_follows_the_fence_after_any_end_of_the_run(what):
    shared = SharedState(1 << 21)
    law = {"an exception": torn, "the fence of another process": shared.raise_fence}.get(what, lambda: None)

    def more():
        if what == "an emergency stop":
            EmergencyStop()(player([False] * 40 + [True], "1", bool))

    rig = rig_of(law, more, options={"shared": shared})
    if what == "NaN":
        robot = robot_with_pump()
        with robot:
            robot.rewired = CubeMars("AK10-9-V2.0", bus="legs", can_id=2, name="hip")
            robot.rewired(torque_command=TorqueLimiter(limit=5.0)(player([0.0] * 40 + [float("nan")], "N·m")))
        plant = plant_with_relay(robot)
        with plant:
            EmulatedCubeMars.of(robot["hip"], name="hip")(position=0.0, velocity=0.0)
        rig = Rig(robot, plant)
    outcome = rig.run(41 if what == "the end" else 100)
    assert (outcome.status == "ok") == (what == "the end") and (outcome.tick == 40)
    found = pulses(rig)
    assert_toggled(found)
    last = 40 if what == "the end" else 39
    assert found[-1][0] == rig.shared.first_tick + last * PERIOD < stop_of(rig)
    assert rig.shared.fenced and rig.shared.state == "safe"


def test_the_line_stops_toggling_when_arming_fails():
    rig = rig_of(plant=False)
    outcome = rig.run(10, arming_timeout=0.1)
    assert outcome.status == "no answer"
    found = pulses(rig)
    assert_toggled(found)
    assert found[-1][0] < stop_of(rig) and round(found[-1][0] * 1e-9, 3) == pytest.approx(START_UP + 0.1, abs=0.006)


def test_the_relay_stays_closed_until_a_damped_joint_is_disabled():
    rig = rig_of(torn, safe_stop="damp", stop_time=0.3)
    outcome = rig.run(100)
    assert outcome.status == "exception" and outcome.unconfirmed == ()
    found = pulses(rig)
    assert stop_of(rig) - (rig.shared.first_tick + 40 * PERIOD) == pytest.approx(0.3e9, abs=2 * PERIOD)
    assert 0 < stop_of(rig) - found[-1][0] <= 2 * PERIOD
    assert_toggled(found, missing=1)  # the tick that raised


def test_a_safe_stop_does_not_close_an_open_relay():
    """In real time: a tick takes longer than the relay holds, and then raises."""

    def late():
        time.sleep(HOLD + 0.03)
        torn()

    rig = rig_of(late, plant=True, options={"virtual": False}, safe_stop="damp", stop_time=0.2, timeout=0.0)
    outcome = rig.run(100)
    assert outcome.status == "exception"
    assert pulses(rig)[-1][0] < rig.shared.first_tick + 40 * PERIOD


def test_a_run_that_waits_to_be_armed_again_sends_no_pulse():
    rig = rig_of(torn, lambda: Rearm()(player([False], "1", bool)))
    outcome = rig.run(120, rearm=[])
    assert outcome.status == "exception" and len(rig.tick) > 100
    found = pulses(rig)
    assert found[-1][0] == rig.shared.first_tick + 39 * PERIOD


def test_lost_line_ends_run_at_once():
    robot = robot_with_pump()
    rig = Rig(robot, plant_with_relay(robot, [False] * 500 + [True]))
    outcome = rig.run(400)
    assert (outcome.status, outcome.culprit) == ("device fault", "pump") and outcome.tick < 100
    assert robot["pump"].fault_in_words(1) == "its line is disconnected, so the relay opens"


# What it covers


def test_protected_drives_are_covered_for_loss_of_both_processes_and_power(tmp_path):
    with Diagram("robot", rate=RATE):
        left, right = (
            CubeMars("AK80-9", bus=f"{side}_leg", can_id=1, name=f"{side}_knee") for side in ("left", "right")
        )
        left(torque_command=0.0), right(torque_command=0.0)
        pump = ChargePump(protects=("left_knee",), name="pump")
    everything = [left, right, pump]
    both = "kill -9 of guardian and control process together, power loss of the computer, suspend of the computer"
    assert (
        f"{both} (the charge pump 'pump')" in in_words(coverage([left], everything))[0]
        and in_words(coverage([left], everything))[1] == ""
    )
    assert in_words(coverage([right], everything))[1].startswith(
        f"{both} (nothing stops right_knee after both processes have ended"
    )
    assert coverage([pump], everything) == []
    pump.protects = ("right_leg",)
    assert in_words(coverage([left], everything))[1] and not in_words(coverage([right], everything))[1]
    pump.protects = ()
    assert not in_words(coverage([left], everything))[1] and not in_words(coverage([right], everything))[1]
    file = write(
        tmp_path,
        """
from blocks.actuators import CubeMars
from blocks.charge_pump import ChargePump
from graph import Diagram

with Diagram("robot", rate=200) as diagram:
    CubeMars("AK80-9", name="knee")(torque_command=0.0)
    ChargePump(name="pump")
""",
    )
    out = " ".join(" ".join(report_lines(check(file), False)).split())
    assert f"{both} (the charge pump 'pump')" in out and "not covered" not in out


def test_loss_and_return_of_the_line_are_detected():
    pump = Wired(ChargePump)
    assert pump.hear(LOST, b"") == NOTED and pump["fault"] == 1.0
    assert pump.hear(BACK, b"") == NOTED and pump["fault"] == 0.0
