"""The supply voltage that a drive reports, compared with its model and with the battery of the rig."""

from types import SimpleNamespace

import pytest

from runtime.robot.rig.battery import Battery
from runtime.setup.commissioning.guided.bench import Result
from runtime.setup.commissioning.guided.passive import compare_supply

BATTERY = Battery(voltage=44.4, capacity=5.0, full_voltage=50.4)


@pytest.mark.parametrize(
    "voltage, battery, found",
    [
        (48.0, None, False),
        (23.0, None, True),
        (61.0, None, True),
        (50.4, BATTERY, False),
        (40.0, BATTERY, False),
        (56.0, BATTERY, True),
        (36.0, BATTERY, True),
    ],
)
def test_a_supply_that_is_not_the_model_s_or_the_battery_s_is_named(voltage, battery, found):
    result = Result()
    compare_supply(result, SimpleNamespace(spec=SimpleNamespace(supply=(24, 60))), battery, voltage)
    assert [name for name, _ in result.findings] == ["supply voltage"] * found
    assert result.measured == {"supply": voltage}
