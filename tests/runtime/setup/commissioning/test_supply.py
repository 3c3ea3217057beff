"""The supply voltage that a drive reports, compared with its model and with the battery of the rig."""

from types import SimpleNamespace

import pytest

from graph.family import Answer
from runtime.robot.rig.battery import Battery
from runtime.setup.commissioning.guided.bench import Given, Result, Sample
from runtime.setup.commissioning.guided.passive import compare_supply, state
from runtime.setup.commissioning.guided.stops import supply_under

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


@pytest.mark.parametrize("voltage, found", [(24.0, False), (8.0, True)])
def test_a_supply_that_each_reply_contains_is_compared(voltage, found):
    """As that of a moteus controller, which has no parameter to read."""
    answer = Answer("moteus", 1, position=0.0, temperature=30.0, voltage=voltage)
    samples = [Sample(0.01 * index, 0.0, 0.0, answer) for index in range(40)]
    bench = SimpleNamespace(at_rest=lambda block: samples, rig=SimpleNamespace(battery=None))
    result = state(bench, SimpleNamespace(spec=SimpleNamespace(supply=(10.0, 54.0), rated=None)), Given(0.0))
    assert [name for name, _ in result.findings] == ["supply voltage"] * found, result


@pytest.mark.parametrize(
    "loaded, own, found, done",
    [
        (23.9, None, [], True),
        (23.9, 23.8, [], True),
        (22.8, None, ["sag of the supply"], True),
        (23.9, 21.0, ["supply voltage"], True),
        (None, 24.0, [], False),
    ],
)
def test_a_supply_under_load_is_what_the_operator_has_read(loaded, own, found, done):
    result = supply_under(24.0, loaded, own, 0.3)
    assert [name for name, _ in result.findings] == found and result.done == done
    assert ("operator says" in result.says[0]) == done and ("not done" in result.says[0]) != done
