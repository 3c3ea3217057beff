"""The zero of a joint against its encoder: each fault is named, none on a healthy pair."""

import math

import pytest

from runtime.setup.commissioning.guided import encoder
from tests.runtime.setup.commissioning.moved import block_of

HEALTHY = [(0.1, 0.1), (0.8, 0.8), (0.1, 0.1)]
CASES = {  # (joint, encoder) in rad at first, turned, back; finding
    "healthy": (HEALTHY, None),
    "at the end of its turn": ([(3.1, 3.1), (3.7, 3.7 - math.tau), (3.1, 3.1)], None),
    "off centre by 2 degrees": ([(0.1, 0.1), (0.8, 0.835), (0.1, 0.1)], None),
    "zero": ([(0.5, 0.1), (1.2, 0.8), (0.5, 0.1)], "zero"),
    "motor turn": (
        [(0.1 + math.tau / 9.0, 0.1), (0.8 + math.tau / 9.0, 0.8), (0.1 + math.tau / 9.0, 0.1)],
        "motor turn",
    ),
    "slips": ([(0.1, 0.1), (0.8, 0.75), (0.1, 0.05)], "slip"),
    "slips back": ([(0.1, 0.1), (0.8, 0.8), (0.1, 0.2)], "slip"),
    "inverted": ([(0.1, 0.1), (0.8, -0.6), (0.1, 0.1)], "direction of the encoder"),
    "of another joint": ([(0.1, 0.1), (0.8, 0.1), (0.1, 0.1)], "encoder"),
    "stuck drive": ([(0.1, 0.1), (0.1, 0.8), (0.1, 0.1)], "encoder"),
}


@pytest.mark.parametrize("case", CASES)
def test_a_joint_is_compared_with_its_encoder(case):
    places, finding = CASES[case]
    result = encoder.encoder_result(block_of("CubeMars", "AK80-9"), "encoder", places)
    assert [name for name, _ in result.findings] == ([finding] if finding else []), result
    assert result.cures.get("offset") == (pytest.approx(0.4) if finding == "zero" else None)
    assert ("reference" in result.cures) == (finding in (None, "zero", "motor turn")) and result.done


def test_a_joint_that_was_not_turned_claims_nothing():
    assert not encoder.encoder_result(block_of("CubeMars", "AK80-9"), "encoder", HEALTHY[:1] * 3).done


@pytest.mark.parametrize(
    "magnets, words", [({0}, ""), ({0, 1}, "weak"), ({2}, "strong"), ({1, 2}, "weak and too strong")]
)
def test_a_field_of_the_magnet_that_the_encoder_reports_as_wrong_is_named(magnets, words):
    result = encoder.encoder_result(block_of("CubeMars", "AK80-9"), "encoder", HEALTHY)
    encoder.compare_magnet(result, "encoder", magnets)
    assert [name for name, _ in result.findings] == ["magnet"] * bool(words)
    assert not words or f"too {words}:" in result.findings[0][1]
