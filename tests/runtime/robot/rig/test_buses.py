"""`--rig` on the command line, and the reports of failed buses. Runs on real buses are in tests/hardware."""

import errno
import json
import os
import socket

import pytest

from blocks.actuators import CubeMars
from graph import Diagram
from runtime.cli.run import parse_run
from runtime.host.errors import CHECK_FAILED, OK
from runtime.host.machine.probe import Machine
from runtime.robot.guardian import GuardianProcess
from runtime.robot.guardian.lock import BusLock
from runtime.robot.rig.buses import RigBuses, in_words
from runtime.robot.rig.errors import RigError
from runtime.robot.rig.file import RigBus, read
from tests.runtime.runs import KNEE_EXO, knee, write
from tests.runtime.setup.doctor.machines import PI_4, lay_out

LEGS = '[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\n'
RANGES = '[device."right/knee"]\nrange = [-0.1, 2.0]\n[device."left/knee"]\nrange = [-0.1, 2.0]\n'
OWN = f"/dev/ttyOf{os.getpid()}"
UNICAST = f"192.0.2.{os.getpid() % 250 + 1}"  # of this process, so that no other worker of pytest holds it
CAN0 = RigBus("legs", "socketcan", "can0")
UP = "sudo ip link set can0 type can bitrate 1000000 restart-ms 100 && sudo ip link set can0 txqueuelen 128 up"


def has_can():
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except (AttributeError, OSError):
        return False
    return True


# The command line


def test_check_proves_the_robot_as_the_rig_has_it(command_line):
    rig = write(command_line.folder, LEGS + "bitrate = 250_000\n" + RANGES + "offset = 0.5\ncan_id = 7\n", "lab.toml")
    code, out, _ = command_line("check", KNEE_EXO, "--rig", rig, "--json")
    found = json.loads(out)
    assert code == OK and found["buses"][0]["bitrate"] == 250_000
    assert json.loads(command_line("check", KNEE_EXO, "--json")[1])["buses"][0]["bitrate"] == 1_000_000


def test_check_reports_errors_that_exist_only_on_the_rig(command_line):
    rig = write(command_line.folder, LEGS + RANGES + "can_id = 2\n", "lab.toml")
    code, out, _ = command_line("check", KNEE_EXO, "--rig", rig)
    assert code == CHECK_FAILED and "TW013" in out
    slow = write(command_line.folder, LEGS + "bitrate = 50_000\n" + RANGES, "slow.toml")
    assert "TW016" in command_line("check", KNEE_EXO, "--rig", slow)[1]


def test_a_setting_of_the_command_line_comes_after_the_rig(command_line):
    rig = write(command_line.folder, LEGS + RANGES + "can_id = 2\n", "lab.toml")
    assert command_line("check", KNEE_EXO, "--rig", rig, "--set", "left/knee.can_id=5")[0] == OK


@pytest.mark.parametrize("command", [["run"], ["check"]])
def test_a_wrong_rig_is_refused_before_anything_else(command_line, command):
    rig = write(command_line.folder, '[bus.leg]\ninterface = "socketcan"\nchannel = "can0"\n', "lab.toml")
    assert command_line.refused(*command, KNEE_EXO, "--rig", rig) == (
        "lab.toml: error TW104 bus without an interface: no interface for bus 'legs'; did you mean 'leg'?\n"
        '    add [bus.legs] with interface = "socketcan" and channel = "can0"'
    )
    assert command_line.refused(*command, KNEE_EXO, "--rig", "lap.toml").startswith("lap.toml: error TW101 ")


def test_virtual_time_and_a_rig_exclude_each_other(command_line):
    rig = write(command_line.folder, LEGS, "lab.toml")
    assert "--fast and --rig exclude each other" in command_line.refused(
        KNEE_EXO, "--rig", rig, "--fast", "--duration", "1"
    )


def test_real_time_is_tried_on_a_rig_and_off_in_simulation():
    assert parse_run(["robot.py"]).realtime == "off" and parse_run(["robot.py", "--rig", "lab.toml"]).realtime == "try"
    assert parse_run(["robot.py", "--rig", "lab.toml", "--realtime", "off"]).realtime == "off"
    assert parse_run(["robot.py", "--rig", "lab.toml", "--priority", "50"]).priority == 50


@pytest.mark.skipif(has_can(), reason="this kernel has CAN")
def test_kernel_without_can_is_reported(command_line):
    rig = write(command_line.folder, LEGS, "lab.toml")
    complaint = command_line.refused(knee(command_line.folder), "--rig", rig, "--yes", "--duration", "1")
    assert (
        complaint.startswith("lab.toml: error TW111 kernel without CAN support: this kernel, ")
        and "sudo modprobe can_raw" in complaint
    )


# Opening


@pytest.fixture
def opened(tmp_path):
    """RigBuses of one knee on a machine that is described in a folder."""

    def opened(text):
        with Diagram("robot", rate=200) as robot:
            CubeMars("AK80-9", bus="legs", name="knee")(torque_command=0.0)
        return RigBuses(
            read(write(tmp_path, text, "lab.toml")), robot, ["legs"], Machine(lay_out(tmp_path / "pi", PI_4))
        )

    return opened


def test_interface_limited_to_one_process_is_reported(opened):
    with pytest.raises(RigError) as caught:
        opened('[bus.legs]\ninterface = "virtual"\nchannel = "legs"\n')
    [trouble] = caught.value.problems
    assert (trouble.code, trouble.message) == (
        "TW105",
        "[bus.legs] interface = 'virtual' has no nodes outside the process that opens it",
    )
    assert "without --rig" in trouble.hint


def test_bus_controlled_by_another_process_is_reported(opened):
    lock = BusLock("slcan", OWN)
    with pytest.raises(
        RigError, match=f"TW106 bus controlled by another process: .* is controlled by process {os.getpid()} "
    ):
        opened(f'[bus.legs]\ninterface = "slcan"\nchannel = "{OWN}"\n')
    lock.close()


def test_interface_that_python_can_cannot_open_is_reported_and_unlocked(command_line):
    rig = write(command_line.folder, f'[bus.legs]\ninterface = "udp_multicast"\nchannel = "{UNICAST}"\n', "lab.toml")
    complaint = command_line.refused(knee(command_line.folder), "--rig", rig, "--yes", "--duration", "1")
    assert complaint.startswith(
        f"lab.toml: error TW119 interface that cannot be opened: [bus.legs] udp_multicast {UNICAST}: could not create "
        "or configure socket"
    )
    BusLock("udp_multicast", UNICAST).close()


def test_without_a_guardian_nothing_is_armed(command_line, monkeypatch):
    class Short(GuardianProcess):
        """Is killed before it can have opened anything."""

        def configure(self, plan):
            self._child.kill()
            self._child.wait()
            super().configure(plan)

    monkeypatch.setattr("runtime.robot.rig.buses.GuardianProcess", Short)
    rig = write(command_line.folder, f'[bus.legs]\ninterface = "udp_multicast"\nchannel = "{UNICAST}"\n', "lab.toml")
    complaint = command_line.refused(knee(command_line.folder), "--rig", rig, "--yes", "--duration", "1")
    assert complaint.startswith(
        "lab.toml: error TW120 no guardian: the guardian was not ready (SIGKILL); nothing was armed"
    )
    BusLock("udp_multicast", UNICAST).close()


@pytest.mark.parametrize(
    "number, words", [(errno.EPERM, "Operation not permitted"), (errno.EACCES, "Permission denied")]
)
def test_missing_permission_is_reported(opened, monkeypatch, number, words):
    """The system call alone is replaced: what refuses it is a sandbox, which no test can put on and take off again."""
    system = socket.socket

    def refuse(*arguments, **options):
        if arguments[0] == getattr(socket, "AF_CAN", None):
            raise PermissionError(number, words)
        return system(*arguments, **options)

    monkeypatch.setattr(socket, "socket", refuse)
    with pytest.raises(RigError, match=f"error TW118 no permission: the system provides no CAN socket: {words}"):
        opened(LEGS)


# Failing


@pytest.mark.parametrize(
    "trouble, virtual, why, cure",
    [
        (
            "bus-off",
            False,
            "can0 is bus-off after too many errors",
            "CAN_H to CAN_H, 120 Ω at both ends, drives on, one bitrate for all; then: sudo ip link set can0 down "
            f"&& {UP}",
        ),
        (
            "full",
            False,
            "the queue of can0 was full for 10 ticks: no node acknowledges its frames, or the bus is overloaded",
            "CAN_H to CAN_H, 120 Ω at both ends, drives on, one bitrate for all; for a longer queue: "
            "sudo ip link set can0 txqueuelen 128",
        ),
        (errno.ENETDOWN, False, "can0 went down", UP),
        (errno.ENETDOWN, True, "can0 went down", "sudo ip link set can0 up"),
        (errno.ENODEV, False, "can0 disappeared: its adapter was unplugged or lost power", f"plug it in, then: {UP}"),
        (errno.ENXIO, False, "can0 disappeared: its adapter was unplugged or lost power", f"plug it in, then: {UP}"),
        (errno.EIO, False, "can0: Input/output error", "see: ip -details -statistics link show can0"),
        (None, False, "can0: sending and receiving failed", "see: ip -details -statistics link show can0"),
    ],
)
def test_failed_bus_is_reported_with_remedy(trouble, virtual, why, cure):
    assert in_words(trouble, CAN0, virtual) == (why, cure)
