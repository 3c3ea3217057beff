"""What stops the motors when the process that drives them cannot: real processes, real signals, and a third node that
listens.
"""

import os
import signal
import time
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from cext.memory.shared_state import SharedState
from runtime.host.live.running import MEMORY
from runtime.record.analysis.trial import Trial
from tests.blocks.actuators import reference
from tests.runtime.robot.guardian.bus import Bus, assert_nothing_is_left, guardian_of, is_torque
from tests.runtime.robot.guardian.drives import AK10_9
from tests.runtime.robot.guardian.test_carrying import suspend
from tests.runtime.runs import DISABLE, ENABLE, NOTHING, Files
from tests.runtime.stuck import family
from tests.soaking import soaked

pytestmark = pytest.mark.paced

DEATH = 0.1  # s from a kill to the last first stop frame, on a machine that may be busy; 0.001 where it is not
STALL = 0.2  # likewise, with the 40 ms that a loop may stand still


@pytest.fixture
def bus(tmp_path):
    with Bus(tmp_path) as bus:
        yield bus


@pytest.mark.hazard("H8d")
def test_kill_9_of_a_run_is_answered_by_its_guardian(bus, tmp_path):
    process = bus.start("--record", "out", cold=True)
    bus.await_torque()
    everybody = family(process)
    killed = time.time()
    process.kill()
    bus.listen(0.3)
    _, err = process.communicate(timeout=10)
    assert bus.stopped_after(killed) < DEATH
    assert (
        "tickwork guardian: the control process died after tick" in err and "confirmed by left/knee, right/knee" in err
    )
    assert_nothing_is_left(everybody, bus.channel)
    [event] = [event for event in Files(tmp_path / "out").sidecar["events"] if event["event"] == "guardian"]
    assert (
        event["because"] == "died" and sorted(event["confirmed"]) == ["left/knee", "right/knee"] and event["took"] < 0.2
    )


def test_run_reports_stop_response_time_of_drives(bus, tmp_path):
    process = bus.start("--record", "out", "--duration", "1")
    out, _ = process.communicate(timeout=20)
    assert (
        process.returncode == 0 and "  replies     left/knee after " in out and "              right/knee after " in out
    )
    [file] = (tmp_path / "out").glob("*.mcap")
    trial = Trial(file)
    for path, found in trial.end["end"]["answers"].items():
        assert (
            path.endswith("/knee")
            and 0.75 * len(trial) < found["count"] <= 200
            and 2e-5 < found["p50"] < 1.0  # the time-out of a drive, which a process plays
            and found["p50"] <= found["p99"]
        )


@pytest.mark.hazard("H8e")
def test_after_kill_stop_and_kill_cont_no_torque_ever_follows(bus):
    process = bus.start("--no-record")
    bus.await_torque()
    everybody = family(process)
    stopped = time.time()
    os.kill(process.pid, signal.SIGSTOP)
    bus.listen(0.4)
    assert bus.stopped_after(stopped) < STALL
    os.kill(process.pid, signal.SIGCONT)
    bus.listen(0.3)
    _, err = process.communicate(timeout=10)
    bus.listen()
    assert bus.stopped_after(stopped) < STALL  # and none since
    assert process.returncode == 3 and "fenced by the guardian" in err and "had stalled for" in err
    assert_nothing_is_left(everybody, bus.channel)


@pytest.mark.soak
def test_after_a_suspend_of_the_computer_no_torque_ever_follows(bus, tmp_path):
    """The run finds that the computer was suspended since it began. A kernel that really suspends one ends the test."""
    process = bus.start("--record", "out")
    bus.await_torque()
    everybody = family(process)
    suspended = time.time()
    for descriptor in Path(f"/proc/{process.pid}/fd").iterdir():
        if os.readlink(descriptor) == f"{MEMORY} (deleted)":
            with open(descriptor, "r+b") as memory, suppress(ValueError):  # of another kind
                assert SharedState(fd=memory.fileno()).control == process.pid
                suspend(memory.fileno(), 3600.0)
                break
    bus.listen(0.3)
    _, err = process.communicate(timeout=10)
    bus.listen()
    assert bus.stopped_after(suspended) < DEATH
    assert process.returncode == 3 and "the computer was suspended for 3600.0 s. The drives kept their last" in err
    assert_nothing_is_left(everybody, bus.channel)
    assert Files(tmp_path / "out").sidecar["ended"].startswith("fault: suspended, tick ")


def test_after_a_pause_of_both_processes_no_torque_follows(bus):
    """As of a container or a cgroup that is frozen: their clocks go on."""
    process = bus.start("--no-record")
    bus.await_torque()
    both = [psutil.Process(process.pid), guardian_of(process)]
    for each in both:
        each.suspend()
    bus.listen(0.5)
    bus.frames.clear()
    resumed = time.time()
    for each in reversed(both):
        each.resume()
    bus.listen(0.3)
    process.communicate(timeout=10)
    bus.listen()
    assert process.returncode == 3 and bus.stopped_after(resumed) < DEATH
    assert not [frame for frame in bus.frames if is_torque(frame)]


def test_after_kill_9_the_joint_is_damped(bus):
    damped = "7FFF7FF0003337FF"  # 1 N·m·s/rad of the 5 that all ones are
    slow = "7FFF7FF0001267FF"  # 18 N·m over 50 rad/s, before the first reply
    process = bus.start("--no-record", drive=', safe_stop="damp", stop_time=0.25')
    bus.await_torque()
    killed = time.time()
    process.kill()
    bus.listen(0.6)
    process.communicate(timeout=10)
    for motor in bus.motors:
        said = bus.commands(motor)
        first = next(place for place, frame in enumerate(said) if frame.data == slow)
        end = next(place for place, frame in enumerate(said) if frame.data == DISABLE)
        assert said[first].time - killed < DEATH and 0.2 < said[end].time - said[first].time < 0.25 + DEATH
        data = [frame.data for frame in said[first : end - 1]]
        assert data.count(damped) > 0.8 * len(data) > 40
        assert {frame.data for frame in said[end - 1 :]} == {NOTHING, DISABLE}


@pytest.mark.hazard("H10b")
def test_after_kill_9_a_moving_joint_is_damped_within_its_limit(tmp_path):
    """Judged from the frames: damping commanded, times the speed that the reply to it reports."""
    with Bus(tmp_path, number=5, motors=(1, 2), moving=True) as bus:
        process = bus.start("--no-record", drive=', limit=5.0, safe_stop="damp", stop_time=0.5')
        bus.await_torque()
        killed = time.time()
        process.kill()
        bus.listen(1.0)
        process.communicate(timeout=10)
        for motor in bus.motors:
            damping, speeds = None, []
            for frame in bus.frames:
                if frame.identifier != motor or frame.time < killed:
                    continue
                data = bytes.fromhex(frame.data)
                if frame.is_command:
                    law = reference.read_command(AK10_9, data) if frame.data not in (NOTHING, DISABLE) else None
                    damping = law["damping"] if law is not None and abs(law["torque"]) < 0.02 else None
                elif damping is not None:
                    speeds.append(abs(reference.read_reply(AK10_9, data)[2]))
                    assert damping * speeds[-1] <= 5.0 + 130.0 / 4095
            assert len(speeds) > 100 and speeds[0] > 7.9 and speeds[-1] < 0.7 * speeds[0]


@pytest.mark.parametrize("by, allowed", soaked([(signal.SIGKILL, DEATH), (signal.SIGSTOP, 0.1 + STALL)], but=[1]))
def test_without_its_guardian_a_run_ends_and_stops_the_motors_itself(bus, by, allowed):
    process = bus.start("--no-record")
    bus.await_torque()
    everybody = family(process)
    killed = time.time()
    guardian_of(process).send_signal(by)
    _, err = process.communicate(timeout=10)
    bus.listen()
    assert bus.stopped_after(killed) < allowed  # 5 to 15 ms after SIGKILL where the machine is not busy
    assert process.returncode == 3 and "the guardian" in err and "SIGKILL" in err
    assert_nothing_is_left(everybody, bus.channel)


def test_a_run_that_is_stopped_while_arming_enables_nothing_afterwards(tmp_path):
    with Bus(tmp_path, number=1, answering=False) as bus:
        process = bus.start("--no-record")
        assert bus.listen(20.0, lambda frame: frame.data == DISABLE), "it is asked, and enabled by nothing"
        everybody = family(process)
        stopped = time.time()
        os.kill(process.pid, signal.SIGSTOP)
        bus.listen(0.5)
        assert bus.stopped_after(stopped) < STALL
        os.kill(process.pid, signal.SIGCONT)
        _, err = process.communicate(timeout=10)
        bus.listen()
        assert bus.stopped_after(stopped) < STALL and process.returncode == 3
        assert (
            "while arming" in err
            and "fenced by the guardian" in err
            and "NOT confirmed by left/knee, right/knee" in err
        )
        assert_nothing_is_left(everybody, bus.channel)


@pytest.mark.hazard("H7d")
def test_commands_of_another_controller_end_the_run(bus):
    process = bus.start("--no-record")
    bus.await_torque()
    bus.send(2, bytes.fromhex(ENABLE))
    out, err = process.communicate(timeout=10)
    bus.listen()
    assert (
        process.returncode == 3
        and "FAULT at right/knee" in err
        and ("another node commands it: a frame to id 2 on bus legs") in err
    )
    assert "confirmed by left/knee, right/knee" in out
    said = [frame.data for frame in bus.commands(1)]
    assert said[-2:] == [NOTHING, DISABLE]


def test_echoed_commands_are_not_replies(tmp_path):
    """Zero torque begins with 7F, and so do the replies of drive 127: a drive that does not answer is not taken for one
    that does.
    """
    with Bus(tmp_path, number=2, motors=(127,), answering=False) as bus:
        process = bus.start("--no-record", "--set", "left/knee.can_id=127", "--set", "right/knee.can_id=126")
        assert bus.listen(20.0, lambda frame: frame.data == NOTHING and frame.identifier == 127), "of the stop"
        _, err = process.communicate(timeout=20)
        assert (
            "no reply from left/knee (id 127 on bus legs), right/knee (id 126 on bus legs); no frame was received on "
            "any bus"
        ) in err


@pytest.mark.hazard("H4e")
def test_a_second_run_on_a_bus_is_rejected_and_disturbs_nothing(bus):
    process = bus.start("--no-record")
    bus.await_torque()
    second = bus.start("--no-record")
    _, err = second.communicate(timeout=20)
    assert second.returncode == 2
    assert (
        f"error TW106 bus controlled by another process: [bus.legs] {bus.channel} is controlled by process "
        f"{process.pid} ("
    ) in err
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=10)  # nobody has disturbed it
    assert process.returncode == 130 and "FAULT" not in err and "confirmed by left/knee, right/knee" in out


@pytest.mark.soak
@pytest.mark.parametrize("victim, share", [(lambda process: process, 98), (guardian_of, 94)], ids=["run", "guardian"])
def test_stop_follows_a_hundred_kills(tmp_path, victim, share):
    """p99 of 20 ms from kill -9 of the run, p95 of that of a guardian, which carries the bus; none may be missed."""
    took = []
    for _ in range(100):
        with Bus(tmp_path, number=3) as bus:
            process = bus.start("--no-record")
            bus.await_torque()
            killed = time.time()
            victim(process).kill()
            bus.listen(0.1)
            process.communicate(timeout=10)
            took.append(bus.stopped_after(killed))
    assert sorted(took)[share] < 0.02, sorted(took)


@pytest.mark.soak
def test_kill_stop_at_any_moment(tmp_path):
    for moment in range(100):
        with Bus(tmp_path, number=4) as bus:
            process = bus.start("--no-record")
            bus.await_torque()
            bus.listen(0.005 * moment / 100)
            stopped = time.time()
            os.kill(process.pid, signal.SIGSTOP)
            bus.listen(0.15)
            os.kill(process.pid, signal.SIGCONT)
            process.communicate(timeout=10)
            bus.listen()
            assert bus.stopped_after(stopped) < STALL
