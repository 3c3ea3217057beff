"""Unique names."""

import pytest

from runtime.host.unique_name import unique


@pytest.mark.parametrize(
    "taken, limit, result",
    [((), None, "knee"), (("knee",), None, "knee_2"), (("knee", "knee_2"), None, "knee_3"), (("kne", "k_2"), 3, "k_3")],
)
def test_a_taken_name_gets_the_first_free_number_within_the_length_limit(taken, limit, result):
    assert unique("knee", taken.__contains__, limit) == result
