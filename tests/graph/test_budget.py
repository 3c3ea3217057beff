"""Bits on the bus, against the fact sheet's table of what 1 Mbit/s carries."""

import pytest

from blocks.actuators import CubeMars
from graph import Diagram, compile
from graph.budget import frame_bits
from tests.graph.complaints import complaint


def actuators(count, rate):
    with Diagram("d", rate=rate) as diagram:
        for number in range(1, count + 1):
            CubeMars("AK80-9", bus="legs", can_id=number, timeout=0.1)(torque_command=0.0)
    return diagram


def test_frame_lengths():
    assert frame_bits(8, False) == (pytest.approx(115.1, abs=0.01), 135)
    assert frame_bits(8, True) == (pytest.approx(135.1, abs=0.01), 160)
    assert frame_bits(0, False) == (47, 55)


@pytest.mark.parametrize("count, highest, worst", [(1, 4343, 3703), (4, 1085, 925), (8, 542, 462)])
def test_the_highest_rate_of_n_actuators(count, highest, worst):
    (load,) = compile(actuators(count, highest)).loads
    assert load.frames == 2 * count * highest and 0.99 < load.typical <= 1.0
    (load,) = compile(actuators(count, worst)).loads
    assert 0.99 < load.worst <= 1.0


def test_a_bus_that_cannot_carry_its_traffic_is_an_error():
    found = complaint(actuators(8, 600))
    assert found.code == "TW016" and "9600 frames a second" in found.message and "bus 'legs' at 1 Mbit/s" in found.message and "8 devices" in found.hint


def test_a_busy_bus_is_a_warning_and_a_quiet_one_is_not():
    assert [w.code for w in compile(actuators(8, 400)).warnings] == ["TW022"]
    assert compile(actuators(2, 200)).warnings == [] and compile(actuators(2, 200)).loads[0].typical == pytest.approx(0.092, abs=1e-3)
