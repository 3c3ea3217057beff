"""slcan over a real pty, with an adapter and its drives played behind it; and serial ports that cannot be opened."""

import fcntl
import os
import pty
import re
import select
import signal
import subprocess
import sys
import termios
import threading
import time
import tty
from contextlib import ExitStack, contextmanager

import pytest

from blocks.actuators import CubeMars
from graph import Diagram
from runtime.host.errors import FAULT, OK
from runtime.robot.emulation.priority import take_priority
from runtime.robot.guardian.lock import BusLock, BusTaken
from runtime.robot.guardian.wires import PythonCanWire
from runtime.robot.rig.buses import RigBuses
from runtime.robot.rig.errors import Refused, RigError
from runtime.robot.rig.file import RigBus, read
from runtime.robot.rig.serial_port import look_at_port
from tests.blocks.actuators import reference
from tests.runtime.robot.guardian.bus import guardian_of
from tests.runtime.robot.guardian.drives import AK10_9
from tests.runtime.runs import DISABLE, ENABLE, NOTHING, ROOT, after_asking, knee, started, write
from tests.soaking import soaked

pytestmark = pytest.mark.paced


class Adapter:
    """An slcan adapter on a pty, and drives that answer every frame to their ids.

    channel : the port
    said : configuration that it received; frames : (id, data in hex digits) that it was given
    """

    def __init__(self, drives=(1,)):
        self.master, port = pty.openpty()
        tty.setraw(port)
        self.channel = os.ttyname(port)
        os.close(port)  # it is for the guardian to open
        self.drives, self.said, self.frames = drives, [], []
        self.unplugged = threading.Event()
        self.thread = threading.Thread(target=self.play, daemon=True)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *exception):
        self.unplug()

    def unplug(self):
        self.unplugged.set()
        self.thread.join()
        if self.master >= 0:
            os.close(self.master)
        self.master = -1

    def play(self):
        take_priority()
        heard = b""
        while not self.unplugged.is_set():
            if not select.select([self.master], [], [], 0.02)[0]:
                continue
            try:
                heard += os.read(self.master, 4096)
            except OSError:  # nobody has the port open
                time.sleep(0.001)
                continue
            *commands, heard = heard.split(b"\r")
            for command in commands:
                os.write(self.master, self.answer(command.decode()))

    def answer(self, command):
        if not command.startswith("t"):
            self.said.append(command)
            return b"\r"
        identifier, data = int(command[1:4], 16), command[5:]
        self.frames.append((identifier, data))
        reply = b""
        if identifier in self.drives:
            data = bytes(reference.held_reply(AK10_9, identifier, 0.1, bytes.fromhex(data)))
            reply = f"t{identifier:03X}{len(data)}{data.hex().upper()}\r".encode()
        return b"z\r" + reply

    def torque(self):
        """Whether torque has been commanded."""
        return any(data not in (ENABLE, DISABLE, NOTHING) for _, data in list(self.frames))


def rig_of(folder, channel, more="sleep_after_open = 0.05\n"):
    return write(
        folder, f'[bus.legs]\ninterface = "slcan"\nchannel = "{channel}"\n[bus.legs.options]\n{more}', "lab.toml"
    )


def run(folder, adapter, *words, **options):
    robot, rig = knee(folder, "return 2.0"), rig_of(folder, adapter.channel, **options)
    return started(robot, "--rig", rig, "--yes", "--no-record", "--stop-for", "0.2", *words, cwd=folder)


def awaited(condition, seconds=10.0):
    deadline = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)
    return condition()


def test_noise_on_the_line_costs_only_the_line_that_contains_it():
    """One byte that is not text made python-can fail at every later line."""
    with Adapter() as adapter:
        wire = PythonCanWire("slcan", adapter.channel, 1_000_000, False)
        try:
            received = []
            for text in (b"t0011AA\r", b"t00\xff\r", b"t0011BB\r", b"\xfe\xff\r\r", b"t0011CC\r"):
                os.write(adapter.master, text)
                for _ in range(10):  # python-can returns nothing for a line that is not a frame
                    time.sleep(0.002)
                    received += [data.hex() for _, data, *_ in wire.receive()]
            assert received == ["aa", "bb", "cc"] and wire.counts["corrupt"] == 2 and wire.trouble is None
        finally:
            wire.close()


def test_a_robot_arms_runs_and_stops_over_slcan(tmp_path):
    with Adapter() as adapter:
        process = run(tmp_path, adapter, "--duration", "0.7")
        out, errors = process.communicate(timeout=20)
        assert process.returncode == OK, errors
        # 1 Mbit/s; open; and closed at the end
        assert "S8" in adapter.said and "O" in adapter.said and adapter.said[-1] == "C"
        told = after_asking([data for _, data in adapter.frames])
        assert told[0] == ENABLE and adapter.torque() and told[-2:] == [NOTHING, DISABLE]
        assert "confirmed by knee" in out and len(told) > 0.9 * int(re.search(r"(\d+) of 140 done", out)[1]), out


@pytest.mark.hazard("H7a")
def test_unplugged_adapter_ends_run_with_message(tmp_path):
    with Adapter() as adapter:
        process = run(tmp_path, adapter)
        assert awaited(adapter.torque), "no torque was commanded"
        adapter.unplug()
        at = time.monotonic()
        _, errors = process.communicate(timeout=10)
        assert process.returncode == FAULT and time.monotonic() - at < 3.0
        assert "Traceback" not in errors
        assert "FAULT at legs, tick " in errors and "the bus can neither send nor receive" in errors
        assert (
            f"slcan {adapter.channel}: the interface has hung up" in errors
            and "check that the adapter is plugged in" in errors
        )


def test_a_guardian_that_dies_leaves_a_run_that_stops_the_motors_over_the_same_adapter(tmp_path):
    """The adapter has been open until then: the run does not wait for it to start."""
    with Adapter() as adapter:
        process = run(tmp_path, adapter, more="sleep_after_open = 0.5\n")
        assert awaited(adapter.torque), "no torque was commanded"
        before = len(adapter.frames)
        guardian_of(process).kill()
        at = time.monotonic()
        while not any(data == DISABLE for _, data in adapter.frames[before:]) and time.monotonic() < at + 2.0:
            time.sleep(0.001)
        took = time.monotonic() - at
        _, errors = process.communicate(timeout=10)
        assert took < 0.1, took  # 5 to 15 ms where the machine is not busy
        assert process.returncode == FAULT and "SIGKILL" in errors
        told = after_asking([data for _, data in adapter.frames])
        assert set(told[told.index(DISABLE) :]) == {NOTHING, DISABLE}


@pytest.mark.soak
def test_an_adapter_without_drives_is_not_armed(tmp_path):
    with Adapter(drives=()) as adapter:
        process = run(tmp_path, adapter)
        _, errors = process.communicate(timeout=20)
        assert (
            process.returncode == FAULT and "no reply from knee (id 1 on bus legs)" in errors and not adapter.torque()
        )


# Ports


def refusal(channel, **options):
    with pytest.raises(Refused) as refused:
        look_at_port(RigBus("legs", "slcan", channel), **options)
    return refused.value.problem


def test_a_missing_port_is_reported_with_the_present_ones(tmp_path):
    for name in ("ttyACM0", "ttyUSB3", "tty7"):
        (tmp_path / name).touch()
    trouble = refusal(str(tmp_path / "ttyACM1"), folder=tmp_path)
    assert (trouble.code, trouble.message) == ("TW125", f"[bus.legs] {tmp_path}/ttyACM1: no such port")
    assert trouble.hint.startswith(f"did you mean '{tmp_path}/ttyACM0'? there are ") and trouble.hint.endswith(
        f"{tmp_path}/ttyUSB3"
    )
    trouble = refusal(str(tmp_path / "ttyACM0"), folder=tmp_path)
    assert (trouble.code, trouble.message) == ("TW125", f"[bus.legs] {tmp_path}/ttyACM0 is not a serial port")
    assert refusal("/dev/ttyNone", folder=tmp_path / "empty").hint == (
        "no serial port found: check that the adapter is plugged in"
    )


def test_a_rig_with_such_a_port_is_refused_before_anything_is_opened(tmp_path):
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK80-9", bus="legs", name="knee")(torque_command=0.0)
    with pytest.raises(RigError, match="TW125 no such serial port"):
        RigBuses(read(rig_of(tmp_path, "/dev/ttyNone@115200")), robot, ["legs"])


@pytest.fixture
def port():
    """A port that this test holds open."""
    master, slave = pty.openpty()
    yield slave
    os.close(slave)
    os.close(master)


def test_port_held_by_another_process_is_reported_with_process_name(port):
    trouble = refusal(os.ttyname(port))
    assert trouble.code == "TW126" and f"{os.ttyname(port)} is in use by " in trouble.message
    assert f"(process {os.getpid()})" in trouble.message


AS_NOBODY = """
import os, sys
sys.path.insert(0, {root!r})
from runtime.robot.rig.file import RigBus
from runtime.robot.rig.serial_port import look_at_port
from runtime.robot.rig.errors import Refused
os.setgroups([]); os.setgid(65534); os.setuid(65534)
try:
    look_at_port(RigBus("legs", "slcan", {channel!r}))
except Refused as refused:
    print(refused.problem)
"""


def as_nobody(port):
    if os.getuid() != 0:
        pytest.skip("needs root, to become somebody else")
    script = AS_NOBODY.format(root=str(ROOT), channel=os.ttyname(port))
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT).stdout


def test_port_without_permission_is_reported_with_commands_that_grant_it(port):
    os.fchmod(port, 0o600)
    os.fchown(port, 0, 20)
    said = as_nobody(port)
    assert said.startswith(
        f"error TW124 serial port without permission: [bus.legs] {os.ttyname(port)}: Permission denied"
    )
    assert (
        "sudo usermod -aG dialout nobody, then log in again" in said and "/etc/udev/rules.d/70-tickwork.rules" in said
    )
    assert "sudo udevadm control --reload" in said


def test_exclusively_held_port_is_reported_if_holder_is_hidden(port):
    fcntl.ioctl(port, termios.TIOCEXCL)
    os.fchmod(port, 0o666)
    said = as_nobody(port)
    assert (
        said.startswith(f"error TW126 serial port in use: [bus.legs] {os.ttyname(port)} is in use")
        and "sudo fuser -v /dev/pts/" in said
    )


# What else an interface takes


def test_interface_options_are_passed_on_unchanged(tmp_path):
    rig = read(rig_of(tmp_path, "/dev/ttyACM0", 'ttyBaudrate = 3_000_000\napp_name = "gait"\nports = [1, 2.5, true]\n'))
    assert rig.buses["legs"].options == {"ttyBaudrate": 3_000_000, "app_name": "gait", "ports": [1, 2.5, True]}


@pytest.mark.parametrize(
    "line, message, hint",
    [
        ('channel = "can1"', "[bus.legs] options.channel: key of the bus itself", "write channel in [bus.legs]"),
        (
            "when = 1979-05-27",
            "[bus.legs] options.when = 1979-05-27: expected text, a number, true or false, or a list of those",
            "remove it",
        ),
        (
            "deep = { a = 1 }",
            "[bus.legs] options.deep = {'a': 1}: expected text, a number, true or false, or a list of those",
            "remove it",
        ),
    ],
)
def test_invalid_options_are_reported(tmp_path, line, message, hint):
    with pytest.raises(RigError) as raised:
        read(rig_of(tmp_path, "/dev/ttyACM0", line))
    assert [(trouble.code, trouble.message, trouble.hint) for trouble in raised.value.problems] == [
        ("TW102", message, hint)
    ]


def test_socketcan_has_no_options(tmp_path):
    rig = write(tmp_path, '[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\noptions = { a = 1 }\n', "lab.toml")
    with pytest.raises(RigError, match="options: socketcan does not use python-can and has no options"):
        read(rig)


def test_can_fd_is_off_by_default(tmp_path):
    assert read(rig_of(tmp_path, "/dev/ttyACM0")).buses["legs"].fd is False


@contextmanager
def unplugged(folder, dies, *words):
    """A run whose adapter is unplugged. Yields the process, what it has said since, a link to the port, and the port.

    dies : the guardian: "never", "at once", or "later", while it continues the stop
    """
    link, said = folder / "port", []
    with Adapter() as adapter, ExitStack() as kept:
        port = adapter.channel
        link.symlink_to(port)
        adapter.channel = str(link)
        process = run(folder, adapter, *words)
        try:
            assert awaited(adapter.torque), "no torque was commanded"
            guardian = guardian_of(process)
            # or another test's adapter gets the name of this port, and its run the stop that continues
            kept.callback(os.close, os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK))
            adapter.unplug()
            while dies == "later" and "continue at a falling rate" not in "".join(said):
                said.append(process.stderr.readline())
            if dies != "never":
                guardian.kill()
            link.unlink()
            yield process, said, link, port
        finally:
            process.kill()


@pytest.mark.hazard("H9d")
@pytest.mark.parametrize(
    "dies, away",
    soaked([*[(dies, away) for dies in ("never", "at once") for away in (0.15, 1.0, 3.0)], ("later", 0.5)], but=[3]),
)
def test_a_drive_gets_its_stop_over_an_adapter_that_returns_late(tmp_path, dies, away):
    """The adapter is plugged in again, as another device under the same link. Its guardian may die meanwhile."""
    with unplugged(tmp_path, dies, "--stop-for", "8") as (process, said, link, _):
        time.sleep(away)  # the time that the adapter is away
        with Adapter() as again:
            link.symlink_to(again.channel)
            at = time.monotonic()
            assert awaited(lambda: DISABLE in [data for _, data in list(again.frames)], 5.0), "it got no stop"
            took = time.monotonic() - at
            out, errors = process.communicate(timeout=10)
        assert took < 1.5 and {data for _, data in again.frames} == {NOTHING, DISABLE}
        assert process.returncode == FAULT and "confirmed by knee" in out
        if away > 0.15:  # the process that continues the stop opens the adapter at once
            assert "NOT confirmed by knee; its frames continue at a falling rate" in "".join(said) + errors
        if (dies, away) != ("at once", 0.15):
            assert re.search(r"confirmed by knee only after [\d.]+ s", out)


@pytest.mark.soak
def test_without_a_guardian_a_stop_that_nothing_confirms_ends_after_the_limit(tmp_path):
    with unplugged(tmp_path, "at once", "--stop-for", "1") as (process, *_):
        began = time.monotonic()
        out, _ = process.communicate(timeout=10)
        assert 1.0 < time.monotonic() - began < 4.0 and "NOT confirmed by knee: cut the power" in out


def test_without_a_guardian_a_stop_that_nothing_confirms_ends_for_the_operator(tmp_path):
    with unplugged(tmp_path, "at once", "--stop-for", "60") as (process, _, _, port):
        line = ""
        while "continue at a falling rate" not in line:
            line = process.stderr.readline()
        with pytest.raises(BusTaken, match="whose stop of knee continues"):
            BusLock("slcan", port)
        time.sleep(0.3)
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=5)
        assert process.returncode == FAULT and "NOT confirmed by knee: cut the power" in out
