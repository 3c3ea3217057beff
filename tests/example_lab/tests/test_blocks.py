"""What every block must keep, and what these two compute."""

import pytest
from gaitlab.blocks import CadenceMeter, LeakyAccumulator

from graph.conformance import check_block


@pytest.mark.parametrize("kind", [CadenceMeter, LeakyAccumulator])
def test_block_passes_the_conformance_test(kind):
    assert check_block(kind)


def test_cadence_of_strikes_half_a_second_apart():
    meter = CadenceMeter()
    strikes = [1.0, 0.0, 0.0, 0.0, 0.0] * 3
    assert [meter.step(strike, 0.1) for strike in strikes][-1] == pytest.approx(120.0)


def test_the_leaky_accumulator_decays():
    accumulator = LeakyAccumulator(leak=0.5)
    assert [accumulator.step(u) for u in (1.0, 0.0, 0.0, 4.0)] == [1.0, 0.5, 0.25, 4.125]
