"""Interfaces of machines that are not here: real controllers down, at another bitrate, bus-off. Virtual ones are in
tests/hardware.
"""

import pytest

from runtime.host.machine.probe import Machine
from runtime.robot.rig.errors import Refused
from runtime.robot.rig.file import RigBus
from runtime.robot.rig.interface_checks import look
from tests.runtime.setup.doctor.machines import LAPTOP, PI_4, can_link, ip, lay_out

UP = "sudo ip link set can0 type can bitrate 1000000 restart-ms 100 && sudo ip link set can0 txqueuelen 128 up"
FLAGS = {"/sys/class/net/can0/flags": "0x40041\n", "/sys/class/net/can0/mtu": "16\n"}


@pytest.fixture
def looked(tmp_path):
    """The Fitness of can0, or of another bus, on a machine and what was changed on it."""

    def looked(*trees, channel="can0", **how):
        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        return look(RigBus("legs", "socketcan", channel, **how), Machine(lay_out(folder, *trees)))

    return looked


def refusal(looked, *trees, **how):
    with pytest.raises(Refused) as caught:
        looked(*trees, **how)
    trouble = caught.value.problem
    return trouble.code, trouble.message, trouble.hint


def link(**how):
    return {"/commands/ip -details -json link": ip(can_link("can0", **how))}


def test_a_controller_that_is_up_at_the_rigs_bitrate_is_fit(looked):
    fitness = looked(PI_4, FLAGS)
    assert not fitness.virtual and fitness.remarks == []
    assert looked(LAPTOP, channel="vcan0").virtual


def test_an_interface_that_is_down_is_reported_with_its_command(looked):
    assert refusal(looked, PI_4, {"/sys/class/net/can0/flags": "0x40040\n"}) == ("TW114", "[bus.legs] can0 is down", UP)


def test_an_interface_at_another_bitrate_is_reported_with_the_command(looked):
    code, message, hint = refusal(looked, PI_4, FLAGS, link(bitrate=500_000))
    assert (code, message) == ("TW115", "[bus.legs] can0 runs at 500000 bit/s, but the rig file specifies 1000000")
    assert hint == f"sudo ip link set can0 down && {UP}"


def test_remedy_uses_bitrate_of_rig(looked):
    code, message, hint = refusal(looked, PI_4, FLAGS, bitrate=250_000)
    assert code == "TW115" and "sudo ip link set can0 type can bitrate 250000 " in hint


def test_a_controller_that_is_bus_off_is_reported_with_the_command(looked):
    code, message, hint = refusal(looked, PI_4, FLAGS, link(state="BUS-OFF"))
    assert (code, message) == ("TW116", "[bus.legs] can0 is bus-off after too many errors")
    assert "120 Ω at both ends" in hint and hint.endswith(f"sudo ip link set can0 down && {UP}")


def test_unacknowledged_controller_is_reported_and_does_not_block_start(looked):
    assert [remark.partition(":")[0] for remark in looked(PI_4, FLAGS, link(state="ERROR-PASSIVE")).remarks] == [
        "can0 is ERROR-PASSIVE"
    ]


def test_bitrate_is_unknown_without_iproute2(looked):
    fitness = looked(PI_4, FLAGS, {"/commands/ip -details -json link": ""})
    assert fitness.remarks == ["can0: its bitrate is unknown; see: ip -details link show can0"] and not fitness.virtual


def test_an_interface_without_can_fd_is_reported_with_the_command(looked):
    code, message, hint = refusal(looked, PI_4, FLAGS, fd=True)
    assert (code, message) == ("TW117", "[bus.legs] can0 does not carry CAN FD")
    assert hint == f"sudo ip link set can0 down && {UP.replace('restart', 'dbitrate 1000000 fd on restart', 1)}"


def test_a_data_bitrate_other_than_the_rigs_is_reported_with_the_command(looked):
    mtu = {"/sys/class/net/can0/mtu": "72\n"}
    flexible = can_link("can0")
    flexible["linkinfo"]["info_data"]["data_bittiming"] = {"bitrate": 2_000_000}
    at_2 = {"/commands/ip -details -json link": ip(flexible)}
    code, message, hint = refusal(looked, PI_4, FLAGS | mtu, at_2, fd=True, data_bitrate=5_000_000)
    assert code == "TW115" and message.endswith("at 2000000 bit/s, but the rig file specifies 5000000")
    assert "type can bitrate 1000000 dbitrate 5000000 fd on restart-ms 100" in hint
    assert looked(PI_4, FLAGS | mtu, at_2, fd=True, data_bitrate=2_000_000).remarks == []


def test_a_missing_interface_is_reported_with_a_suggestion(looked):
    assert refusal(looked, PI_4, channel="can1") == ("TW112", '[bus.legs] channel = "can1"', "did you mean 'can0'?")
    assert refusal(looked, PI_4, channel="pcan_usb")[2] == "this machine has can0"
    assert refusal(looked, PI_4, channel="lo")[0] == "TW113"


def test_a_machine_without_can_interfaces_is_reported(looked):
    code, _, hint = refusal(looked, {"/sys/class/net/lo/type": "772\n"})
    assert code == "TW112" and "check that the adapter is plugged in" in hint
