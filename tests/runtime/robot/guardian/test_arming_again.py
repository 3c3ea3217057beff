"""A run on a rig that is armed again after a fault, by the operator at a terminal: real processes and an observer that
listens.
"""

import os
import signal
import time

import pytest

from tests.runtime.robot.guardian.bus import PATIENT, ROBOT, Bus, assert_nothing_is_left, is_torque
from tests.runtime.runs import DISABLE, ENABLE, NOTHING, TORQUE_STEP, Files, finished, knee, torque_of, write
from tests.runtime.stuck import family
from tests.runtime.terminals import Terminal
from tests.soaking import soaked

pytestmark = pytest.mark.paced

NAN = "if 60 <= tick < 300: return float('nan'), False"
WAITS = "the run waits in its safe stop: press r to arm again; space to end"


@pytest.fixture
def bus(tmp_path):
    with Bus(tmp_path, number=8) as bus:
        yield bus


@pytest.fixture
def terminal():
    with Terminal() as found:
        yield found


def under_torque(bus, terminal, *words, law="pass"):
    robot = write(bus.folder, ROBOT.format(law=law, torque=2.0, more="", blocks="", drive=PATIENT))
    terminal.run(robot, "--rig", bus.rig, "--yes", "--rearm", *words, cwd=bus.folder)
    bus.await_torque()


def between(bus, motor):
    """Frames to a motor from the safe stop until it is enabled again, or to the end."""
    said = [frame.data for frame in bus.commands(motor)]
    first = said.index(DISABLE)
    return said[first : said.index(ENABLE, first) if ENABLE in said[first:] else None]


def after(bus, motor):
    """Frames to the motor from then on."""
    said = [frame.data for frame in bus.commands(motor)]
    return said[said.index(ENABLE, said.index(DISABLE)) :]


def test_run_rearms_after_nan_when_r_is_pressed_and_fades_torque_in(bus, terminal, tmp_path):
    under_torque(bus, terminal, "--record", "out", law=NAN)
    terminal.wait_for("press r to arm again")
    shown = terminal.look()
    assert WAITS in shown and "FAULT at left/knee, tick 60 (0.3 s): a command is NaN or infinite" in shown
    terminal.answer(b"r", "not armed again, the cause persists: left/knee: a command is NaN or infinite")
    terminal.wait_for("waiting .* r arms again, space ends")
    bus.listen(1.5)  # until tick 300 has passed
    assert bus.commands(1)[-1].data != ENABLE and set(between(bus, 1)) <= {NOTHING, DISABLE}
    terminal.answer(b"r", "arming again at tick")
    bus.await_torque()
    bus.listen(0.8)
    terminal.press(b" ")
    assert terminal.end() == 0
    bus.listen()
    assert "faults not finite at left/knee, tick 60, survived" in terminal.words()
    for motor in bus.motors:
        stood = between(bus, motor)
        assert set(stood) <= {NOTHING, DISABLE} and stood.count(DISABLE) > 200
        said = after(bus, motor)
        torques = [torque_of(data) for data in said if data not in (ENABLE, DISABLE, NOTHING)]
        assert torques[0] < 0.2 and torques == sorted(torques) and torques[-1] == pytest.approx(2.0, abs=TORQUE_STEP)
        assert 50 < sum(torque < 1.9 for torque in torques) < 110  # half a second
        assert said[-2:] == [NOTHING, DISABLE]
    files = Files(tmp_path / "out")
    told = [
        (event["event"], event.get("by"))
        for event in files.sidecar["events"]
        if event["event"] in ("fault", "rearm refused", "rearm", "armed again")
    ]
    assert told == [("fault", None), ("rearm refused", None), ("rearm", "keys"), ("armed again", None)]
    assert (
        files.sidecar["end"]["faults"] == [["not finite", "left/knee", 60]]
        and files.sidecar["ended"] == "stopped by the space bar"
    )
    ticks = list(files.table["tick"])
    assert ticks == sorted(set(ticks))
    replayed = finished("replay", files.one(".mcap"), cwd=tmp_path)
    assert replayed.returncode == 0, replayed.stdout
    assert "replayed up to the fault at tick 60, after which the run waited to be armed again" in replayed.stdout
    assert "are the same, bit for bit" in replayed.stdout


@pytest.mark.hazard("H4c")
@pytest.mark.parametrize(
    "begin, end, words",
    soaked(
        [
            (signal.SIGSTOP, signal.SIGCONT, "no reply for longer than its timeout (1 s)"),
            (signal.SIGUSR1, signal.SIGUSR2, "the device reports a fault"),
        ],
        but=[1],
    ),
)
def test_only_the_operator_arms_recovered_drives_again(bus, terminal, begin, end, words):
    under_torque(bus, terminal, "--no-record")
    bus.drives.send_signal(begin)
    terminal.wait_for("press r to arm again")
    assert words in terminal.words()
    terminal.answer(b"r", rf"not armed again, the cause persists: (left|right)/knee: {words.split(' (')[0]}")
    bus.drives.send_signal(end)
    bus.listen(0.3)
    # the cause is gone, and nobody has asked:
    assert all(set(between(bus, motor)) <= {NOTHING, DISABLE} for motor in bus.motors)
    assert all(bus.commands(motor)[-1].data == DISABLE for motor in bus.motors)  # nothing has been enabled
    terminal.answer(b"r", "arming again at tick")
    bus.await_torque()
    for motor in bus.motors:
        assert set(between(bus, motor)) <= {NOTHING, DISABLE} and after(bus, motor)[0] == ENABLE
    terminal.press(b" ")
    assert terminal.end() == 0


def test_waiting_run_is_not_rearmed_after_sigstop_and_sigcont(bus, terminal):
    under_torque(bus, terminal, "--no-record", law=NAN.replace("300", "61"))
    terminal.wait_for("press r to arm again")
    everybody = family(terminal.process)
    os.kill(terminal.process.pid, signal.SIGSTOP)
    bus.listen(0.4)
    os.write(terminal.master, b"r")
    os.kill(terminal.process.pid, signal.SIGCONT)
    assert terminal.end() == 3 and "fenced by the guardian" in terminal.words()
    bus.listen(0.1)
    for motor in bus.motors:
        assert set(between(bus, motor)) <= {NOTHING, DISABLE}
    assert_nothing_is_left(everybody, bus.channel)


def test_a_loop_that_is_stopped_while_it_arms_again_is_fenced_for_good(bus, terminal):
    under_torque(bus, terminal, "--no-record", law=NAN.replace("300", "61"))
    terminal.wait_for("press r to arm again")
    terminal.answer(b"r", "arming again at tick")
    bus.await_torque()
    stopped = time.time()
    os.kill(terminal.process.pid, signal.SIGSTOP)
    bus.listen(0.4)
    os.kill(terminal.process.pid, signal.SIGCONT)
    assert terminal.end() == 3 and "fenced by the guardian" in terminal.words()
    bus.listen()
    for motor in bus.motors:
        said = bus.commands(motor, since=stopped + 0.2)
        assert not any(is_torque(frame) or frame.data == ENABLE for frame in said) and [
            frame.data for frame in bus.commands(motor)
        ][-2:] == [NOTHING, DISABLE]


def test_ending_a_waiting_run_exits_with_the_fault(bus, terminal):
    under_torque(bus, terminal, "--no-record", law=NAN)
    terminal.wait_for("press r to arm again")
    terminal.press(b" ")
    assert terminal.end() == 3 and "a command is NaN or infinite; it was not armed again" in " ".join(
        terminal.look().split()
    )


def test_rearm_is_refused_without_operator_input(command_line):
    robot = knee(command_line.folder)
    assert "--rearm: nothing can request arming" in command_line.refused(robot, "--rearm", "--duration", "1")
    assert "--fast and --rearm exclude each other" in command_line.refused(
        robot, "--rearm", "--fast", "--duration", "1"
    )


def test_a_button_in_the_diagram_arms_again_in_simulation(command_line):
    law = "return math.nan if tick == 60 else 2.0"
    button = """
    class Button(Block):
        pressed = Output("1", dtype=bool)

        def step(self, t):
            return t > 1.0

    Rearm(name="again")(Button(name="button")())
"""
    robot = knee(command_line.folder, law)
    robot.write_text(
        robot.read_text().replace("import math\n", "import math\n\nfrom blocks.safety import Rearm\n") + button
    )
    code, out, err = command_line(robot, "--fast", "--duration", "2", "--no-record")
    assert code == 0 and "faults      not finite at knee, tick 60, survived" in out and "400 of 400" not in out
    # said by the recorder, on the real standard error
    assert "a rising again.request to arm again" in err or "FAULT" not in err
    robot.write_text(robot.read_text().replace("t > 1.0", "t > 0.1"))
    code, out, err = command_line(robot, "--fast", "--duration", "2", "--no-record")
    assert code == 3 and "FAULT at knee, tick 60" in err and "it was not armed again" in err
