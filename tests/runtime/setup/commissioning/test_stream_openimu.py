"""`stream openimu` over real udp_multicast: a unit as it is sold is told its axes, and shown in them."""

import pytest

from blocks.imus import EmulatedOpenImu
from blocks.imus.openimu import frames
from runtime.host.errors import BAD_INPUT, OK
from runtime.setup.commissioning import watched_node
from tests.blocks.actuators.wire import EXTENDED, Wired
from tests.runtime.setup.commissioning.nodes import Node, Nodes, OpenImu

pytestmark = pytest.mark.paced


class Unit(Node):
    """The emulated unit as a node: it turns, and lies on its left side."""

    period = 0.01

    def __init__(self):
        super().__init__()
        self.unit = Wired(EmulatedOpenImu)
        self.unit["accel"], self.unit["gyro"] = (1.0, 9.5, -2.0), (0.1, 0.2, 0.3)

    def frames(self):
        return [(identifier & ~EXTENDED, True, data) for identifier, data in self.unit.say()]

    def speak(self):
        self.unit.arena[0] += 0.01
        return self.frames()

    def hear(self, identifier, extended, data):
        self.unit.hear(identifier | EXTENDED * extended, data)
        return self.frames()


def test_a_unit_is_set_up_shown_and_recorded(command_line):
    unit = Unit()
    with Nodes(90, unit) as nodes:
        code, out, err = command_line("stream", "openimu", "128", *nodes.words, "--duration", "0.5", "--record", "out")
    assert (
        (code, err) == (OK, "")
        and "OpenIMU 300RI at address 128 on" in out
        and ("accel    1.000    9.500   -2.000 m/s²") in out
    )
    assert frames.behaviour(128, "300RI") in unit.heard
    [file] = (command_line.folder / "out").glob("imu_128_*.csv")
    header, *rows = file.read_text().splitlines()
    assert header.split(",")[2] == "imu_128.accel[0] [m/s^2]"
    assert [float(x) for x in rows[-1].split(",")[5:8]] == pytest.approx([0.1, 0.2, 0.3], abs=2e-4)


def test_a_unit_without_settings_is_distinguished_from_a_missing_one(command_line, monkeypatch):
    monkeypatch.setattr(watched_node, "SETTINGS_TIMEOUT", 0.3)
    with Nodes(91, OpenImu(address=130)) as nodes:
        code, _, err = command_line("stream", "openimu", "130", *nodes.words)
        assert (
            code == BAD_INPUT
            and (
                "sends frames but does not return its settings: check that it is a 300RI. "
                "Pass --keep-settings to read it with its present settings"
            )
            in err
        )
        code, _, err = command_line("stream", "openimu", "131", *nodes.words)
        assert code == BAD_INPUT and "no sensor responds at address 131" in err
    assert (
        "expected a whole number from 128 to 247"
        in command_line("stream", "openimu", "12", "--interface", "virtual", "--channel", "x")[2]
    )
