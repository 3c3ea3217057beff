"""The guardian over real SocketCAN: a run is killed or stopped, and a third party on the bus hears the motors being
disabled.
"""

import os
import re
import signal
import time

import pytest

from tests.hardware.drives import Drives, is_answer
from tests.hardware.test_socketcan import spare  # noqa: F401
from tests.hardware.vcan import Node, ip, needs_own_kernel, needs_vcan
from tests.runtime.robot.guardian.bus import guardian_of
from tests.runtime.robot.guardian.test_every_fault import ROBOT
from tests.runtime.runs import DISABLE, ENABLE, NOTHING, after_asking, knee, started, write

pytestmark = [needs_vcan, pytest.mark.soak]
MOTOR = {1: 0.3}
LIMIT = 0.25  # s, under an emulated kernel


class Listener(Node):
    """A node that remembers when it heard what: (s of time.monotonic, hex digits of a command)."""

    def __init__(self):
        super().__init__()
        self.commands = []

    def listen(self, seconds, until=lambda data: False):
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            for identifier, data in self.heard():
                if identifier == 1 and not is_answer(1, data):
                    self.commands.append((time.monotonic(), data.hex().upper()))
                    if until(self.commands[-1][1]):
                        return True
            time.sleep(0.001)
        return False

    def assert_stopped(self, since):
        words = after_asking([data for _, data in self.commands])
        end = words.index(DISABLE)
        assert words[end - 1] == NOTHING and set(words[end - 1 :]) == {NOTHING, DISABLE}
        assert self.commands[end - len(words)][0] - since < LIMIT


@pytest.fixture
def run(tmp_path, request):
    """A run under torque, and who listens. Its parameter is what the knee is told to do."""
    rig = tmp_path / "lab.toml"
    rig.write_text(
        '[bus.legs]\ninterface = "socketcan"\nchannel = "vcan0"\n'
        "[device.knee]\nrange = [-12.5, 12.5]\nwake_shift = 0.0\n"
    )
    with Drives(MOTOR), Listener() as listener:
        process = started(
            knee(tmp_path, law=getattr(request, "param", "return 2.0")),
            "--rig",
            rig,
            "--yes",
            "--rate",
            "50",
            "--no-record",
            "--realtime",
            "off",
            "--set",
            "knee.timeout=0.5",
            cwd=tmp_path,
        )
        assert listener.listen(30.0, lambda data: data not in (ENABLE, NOTHING)), process.communicate(timeout=10)
        yield process, listener
        process.kill()
        process.communicate(timeout=30)


def test_kill_9_of_the_run_stops_the_motors(run):
    process, listener = run
    killed = time.monotonic()
    process.kill()
    listener.listen(0.5)
    listener.assert_stopped(killed)
    assert "the control process died after" in process.communicate(timeout=30)[1]


def test_kill_stop_and_kill_cont(run):
    process, listener = run
    stopped = time.monotonic()
    os.kill(process.pid, signal.SIGSTOP)
    listener.listen(0.6)
    listener.assert_stopped(stopped)
    os.kill(process.pid, signal.SIGCONT)
    _, err = process.communicate(timeout=30)
    listener.listen(0.1)
    listener.assert_stopped(stopped)
    assert process.returncode == 3 and "fenced by the guardian" in err


@pytest.mark.parametrize("run", ["while tick == 60: pass\n        return 2.0"], indirect=True)
def test_a_hanging_block_stops_the_motors(run):
    process, listener = run
    assert listener.listen(10.0, lambda data: data == DISABLE)
    last = max(at for at, data in listener.commands if data not in (ENABLE, NOTHING, DISABLE))
    _, err = process.communicate(timeout=30)
    listener.listen(0.1)
    listener.assert_stopped(last + 0.08)  # the next tick, and the three periods that it may work
    assert process.returncode == 3 and "FAULT at law, tick 60" in err and "it hung: " in err and "robot.py:" in err


@needs_own_kernel
@pytest.mark.parametrize(
    "change, words", [(("set", "vcan9", "down"), "vcan9 went down"), (("del", "vcan9"), "vcan9 disappeared")]
)
def test_a_lost_interface_stops_the_drives_of_the_other(tmp_path, spare, change, words):  # noqa: F811  (a fixture)
    rig = write(
        tmp_path,
        "".join(
            f'[bus.{side}]\ninterface = "socketcan"\nchannel = "{channel}"\n'
            for side, channel in (("left", "vcan0"), ("right", "vcan9"))
        ),
        "lab.toml",
    )
    robot = write(tmp_path, ROBOT.format(law="pass", torque="2.0", before="", options="", more="pass"))
    with Drives(MOTOR), Drives({2: 0.3}, spare), Listener() as listener:
        process = started(
            robot,
            "--rig",
            rig,
            "--yes",
            "--rate",
            "50",
            "--no-record",
            "--realtime",
            "off",
            "--set",
            "left/knee.timeout=0.5",
            "--set",
            "right/knee.timeout=0.5",
            cwd=tmp_path,
        )
        assert listener.listen(30.0, lambda data: data not in (ENABLE, NOTHING)), process.communicate(timeout=10)
        listener.listen(0.5)
        ip(*change)
        gone = time.monotonic()
        listener.listen(1.0)
        out, err = process.communicate(timeout=30)
        listener.listen(0.1)
        listener.assert_stopped(gone)
    assert process.returncode == 3 and "FAULT at right, tick " in err and words in err, out + err
    # under an emulated kernel the left one may be too slow, too
    assert re.search("NOT confirmed by .*right/knee", out), out


def test_kill_9_of_the_guardian(run):
    process, listener = run
    killed = time.monotonic()
    guardian_of(process).kill()
    listener.listen(0.5)
    _, err = process.communicate(timeout=30)
    listener.assert_stopped(killed)
    assert process.returncode == 3 and "the guardian does not respond" in err


@needs_own_kernel
@pytest.mark.parametrize("dead", [False, True], ids=["with its guardian", "without"])
@pytest.mark.parametrize("away", [0.15, 1.0, 3.0])
def test_a_drive_gets_its_stop_over_an_interface_that_returns_late(tmp_path, spare, away, dead):  # noqa: F811
    rig = write(tmp_path, '[bus.legs]\ninterface = "socketcan"\nchannel = "vcan9"\n', "lab.toml")
    words = ["--rate", "50", "--no-record", "--realtime", "off", "--stop-for", "20", "--set", "knee.timeout=0.5"]
    with Drives(MOTOR, spare), Node(spare) as node:
        process = started(knee(tmp_path, law="return 2.0"), "--rig", rig, "--yes", *words, cwd=tmp_path)
        deadline = time.monotonic() + 30.0
        torque = {ENABLE, NOTHING, DISABLE}
        while time.monotonic() < deadline and not any(
            identifier == 1 and not is_answer(1, data) and data.hex().upper() not in torque
            for identifier, data in node.heard()
        ):
            time.sleep(0.01)
        guardian = guardian_of(process)
        ip("set", "vcan9", "down")
        if dead:
            guardian.kill()
    with Node(spare) as node:
        time.sleep(away)  # the time that the interface is down
        with pytest.raises(OSError, match="Network is down"):
            node.heard()
        ip("set", "vcan9", "up")
        came, heard = time.monotonic(), []
        with Drives(MOTOR, spare):
            while DISABLE not in heard and time.monotonic() - came < 10.0:
                heard += [data.hex().upper() for identifier, data in node.heard() if identifier == 1]
                time.sleep(0.01)
            took = time.monotonic() - came
            out, err = process.communicate(timeout=30)
    assert DISABLE in heard and took < 3.0, out + err
    assert process.returncode == 3 and "confirmed by knee" in out and "NOT confirmed" not in out, out + err
