"""Forces out of voltages."""

import math

import pytest

from blocks.sensors import FSR, LoadCell
from blocks.sources import TimeTable
from graph import Diagram, DiagramError
from tests.blocks.running import run


def test_a_load_cell_is_tared_with_the_mean_of_its_first_samples():
    with Diagram("cell", rate=100) as diagram:
        signal = TimeTable(times=(0.0, 0.195, 0.205, 1.0), values=(1.65, 1.65, 2.15, 2.15), unit="V")
        LoadCell(capacity=200.0, at_capacity=1.0, tare_time=0.1, name="cell")(signal.y)
    record = run(diagram, 40)
    assert record["cell.force"][:19] == pytest.approx([0.0] * 19, abs=1e-9)
    assert record["cell.force"][25:] == pytest.approx([100.0] * 15, rel=1e-12)


def test_a_load_cell_is_tared_on_an_edge_without_nan_samples():
    cell = LoadCell(capacity=10.0, at_capacity=2.0, zero=0.5, tare_at_start=False, tare_time=0.02)
    cell.dt = 0.01
    cell.prepare(0.01)
    assert cell.step(1.5, False) == pytest.approx(5.0)
    assert math.isnan(cell.step(math.nan, True))
    assert cell.step(1.0, True) == 0.0
    assert cell.step(2.0, True) == pytest.approx(2.5)  # the mean of both is its zero
    assert cell.step(3.5, True) == pytest.approx(10.0)


def test_a_force_sensitive_resistor_is_a_conductance():
    """U = 3.3 V, R = 10 kΩ: with 2.5 kΩ in the sensor, 2.64 V and 25 kN·Ω / 2.5 kΩ = 10 N."""
    fsr = FSR()
    force, pressed = fsr.step(2.64)
    assert force == pytest.approx(10.0, rel=1e-12) and pressed
    assert fsr.step(0.0) == (0.0, False) and fsr.step(-0.1)[0] == 0.0
    assert fsr.emulator(supply=3.3).step(10.0) == pytest.approx(2.64, rel=1e-12)
    assert fsr.step(3.3)[0] == 100.0 and fsr.step(3.4)[0] == 100.0 and fsr.step(3.2999999)[0] == 100.0


def test_an_emulated_resistor_inverts_the_sensor():
    fsr = FSR(supply=5.0, resistor=3e3, sensitivity=40e3)
    divider = fsr.emulator()
    for force in (0.0, 0.1, 7.0, 99.0):
        assert fsr.step(divider.step(force))[0] == pytest.approx(force, rel=1e-9, abs=1e-12)
    assert divider.step(-5.0) == 0.0 and divider.step(1e300) <= 5.0
    assert math.isnan(divider.step(math.nan)) and math.isnan(divider.step(math.inf))


def test_contact_has_hysteresis_and_nan_does_not_change_it():
    fsr = FSR(press=5.0, release=3.0)

    def voltage(force):
        return 3.3 * 10e3 / (10e3 + 25e3 / force)

    assert [fsr.step(voltage(force))[1] for force in (4.0, 5.1, 4.0, 3.1, 2.9, 4.9)] == [
        False,
        True,
        True,
        True,
        False,
        False,
    ]
    fsr.step(voltage(9.0))
    force, pressed = fsr.step(math.nan)
    assert math.isnan(force) and pressed


@pytest.mark.parametrize(
    "kind, parameters, words",
    [
        (FSR, {"press": 2.0, "release": 3.0}, r"release must be at most press"),
        (LoadCell, {"at_capacity": 0.0}, "must not be 0"),
        (LoadCell, {"capacity": 0.0}, "above 0"),
    ],
)
def test_invalid_parameters_are_refused(kind, parameters, words):
    with pytest.raises(DiagramError, match=words):
        kind(**parameters)
