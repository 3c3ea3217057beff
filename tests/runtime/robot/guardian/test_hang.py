"""Blocks that hang or crash under a robot of real processes: the motors are stopped at once, and the report names the
block.
"""

import re
import signal
import time

import pytest

from tests.cext.spinning import BLOCK, compiled, needs_compiler
from tests.runtime.robot.guardian.bus import Bus, assert_nothing_is_left, is_torque
from tests.runtime.runs import DISABLE, Files, line_of
from tests.runtime.stuck import family
from tests.soaking import soaked

pytestmark = pytest.mark.paced

LIMIT = 0.005 + 0.015  # s from the last torque to the next tick, and what that may work
ALLOWANCE = 0.08  # s, on a machine that may be busy; 0.001 where it is not
BELOW = ("--priority", "10")  # a block that spins keeps no processor from the runs and drives of other tests


@pytest.fixture
def bus(tmp_path):
    with Bus(tmp_path) as bus:
        yield bus


def stopped_in_time(bus, seconds=0.3):
    """s from the last torque to the stop, which every motor has had. No torque follows it."""
    assert bus.listen(3.0, lambda frame: frame.data == DISABLE) is not None
    bus.listen(seconds)
    took = bus.stopped_after(max(frame.time for frame in bus.frames if is_torque(frame)))
    assert took < LIMIT + ALLOWANCE
    return took


HANGS = {
    "a loop without an end": "while tick > 40: pass",
    "a sleep": "if tick > 40: time.sleep(10.0)",
    "C code that holds the GIL": "if tick > 40: ctypes.PyDLL(None).usleep(10_000_000)",
}


@pytest.mark.parametrize("what", soaked(list(HANGS), but=[2]))
def test_hanging_python_block_is_reported_with_its_line(bus, tmp_path, what):
    process = bus.start("--record", "out", *BELOW, law=HANGS[what])
    bus.await_torque()
    everybody = family(process)
    stopped_in_time(bus)
    out, err = process.communicate(timeout=10)
    assert process.returncode == 3 and "confirmed by left/knee, right/knee" in out
    assert (
        "tickwork guardian: left/law hangs: " in err
        and "after tick" in err
        and "; zero torque" in err
        and "still hangs" not in err
    )
    assert re.search(
        r"FAULT at left/law, tick 4\d .*: it hung: its step ran for [\d.]+ ms until the watchdog interrupted it; "
        r"the motors were stopped meanwhile",
        err,
    )
    assert f"robot.py:{line_of(tmp_path / 'robot.py', HANGS[what])} in step: {HANGS[what]}" in err
    assert "KeyboardInterrupt" not in err and "Traceback" not in err
    assert_nothing_is_left(everybody, bus.channel)
    sidecar = Files(tmp_path / "out").sidecar
    assert re.fullmatch(r"fault: hung at left/law, tick 4\d", sidecar["ended"])
    [event] = [event for event in sidecar["events"] if event["event"] == "guardian"]
    assert (event["because"], event["block"], event["last_tick"]) == ("hung", "left/law", sidecar["last_tick"])


STUCK = (
    "if tick > 40: lock = ctypes.create_string_buffer(64); take = ctypes.PyDLL(None).pthread_mutex_lock; "
    "take(lock); take(lock)"
)


@needs_compiler
@pytest.mark.parametrize(
    "by, where", [(signal.SIGINT, "late/spin"), pytest.param(signal.SIGTERM, "left/law", marks=pytest.mark.soak)]
)
def test_uninterruptible_block_is_reported_until_operator_kills_it(bus, tmp_path, by, where):
    if where == "late/spin":
        how = {
            "blocks": BLOCK.format(library=compiled(tmp_path)),
            "more": "with subsystem('late', enabled=law.late): Spin()(1e9)",
        }
    else:
        how = {"law": STUCK}
    process = bus.start("--record", "out", *BELOW, **how)
    bus.await_torque()
    everybody = family(process)
    stopped_in_time(bus, 0.5)
    assert process.poll() is None
    asked = time.monotonic()
    process.send_signal(by)
    _, err = process.communicate(timeout=10)
    assert process.returncode == 3 and time.monotonic() - asked < 5.0
    assert (
        f"tickwork guardian: {where} hangs: " in err
        and ("zero torque, then disable: confirmed by left/knee, right/knee") in err
    )
    assert f"tickwork guardian: {where} still hangs, with the motors stopped; Ctrl-C ends the run" in err
    bus.listen()
    bus.stopped_after(0.0)
    assert_nothing_is_left(everybody, bus.channel)
    files = Files(tmp_path / "out")
    assert files.sidecar["last_tick"] == files.table["tick"][-1] >= 38


CRASHES = {
    signal.SIGSEGV: "if tick > 40: ctypes.string_at(0)",
    signal.SIGABRT: "if tick > 40: ctypes.CDLL(None).abort()",
}


@pytest.mark.hazard("H8c")
@pytest.mark.parametrize("number", soaked(list(CRASHES), but=[0]))
def test_motors_stop_when_a_block_kills_the_process(bus, tmp_path, number):
    process = bus.start("--record", "out", law=CRASHES[number])
    bus.await_torque()
    everybody = family(process)
    stopped_in_time(bus)
    _, err = process.communicate(timeout=10)
    assert process.returncode == -number
    assert f"tickwork guardian: the control process died of {number.name} in left/law after tick " in err
    assert "; zero torque, then disable: confirmed by left/knee, right/knee" in err
    assert "Traceback" not in err
    assert_nothing_is_left(everybody, bus.channel)
    [event] = [event for event in Files(tmp_path / "out").sidecar["events"] if event["event"] == "guardian"]
    assert (event["because"], event["signal"], event["block"]) == ("died", number.name, "left/law")


def test_repeated_ctrl_c_acts_once(bus):
    process = bus.start("--no-record")
    bus.await_torque()
    for _ in range(40):
        process.send_signal(signal.SIGINT)
        bus.listen(0.0005)
    out, err = process.communicate(timeout=10)
    bus.listen()
    bus.stopped_after(0.0)
    assert process.returncode == 130 and "confirmed by left/knee, right/knee" in out and "Traceback" not in err
