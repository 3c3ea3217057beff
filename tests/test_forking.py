"""Child processes of tests end, and never go on with the tests."""

import signal

import pytest

from tests.forking import exit_code, fork


def failing():
    raise ValueError("on purpose")


@pytest.mark.parametrize(
    "work, code",
    [
        (lambda: None, 0),
        (lambda: 7, 7),
        (failing, 99),
        (lambda: pytest.exit("on purpose"), 99),
        (lambda: signal.raise_signal(signal.SIGKILL), -signal.SIGKILL),
    ],
)
def test_a_child_ends_with_its_exit_code(work, code):
    assert exit_code(fork(work)) == code
