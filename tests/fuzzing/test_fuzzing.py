"""No crash, no hang, nothing out of bounds, no wrong checksum believed, every good packet found: a fuzzer looks, guided by coverage.

`make soak` gives each parser some seconds, TICKWORK_FUZZ_SECONDS more. What it finds is kept in build/fuzzing, and begun with next time.
"""

import os

import pytest

from tests.fuzzing.laboratory import Laboratory, why_not
from tests.fuzzing.targets import EVERYTHING

SECONDS = float(os.environ.get("TICKWORK_FUZZ_SECONDS", 5))

pytestmark = [pytest.mark.soak, pytest.mark.skipif(bool(why_not()), reason=why_not())]


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory):
    return Laboratory(tmp_path_factory.mktemp("fuzzing") / "copy")


@pytest.mark.parametrize("name", EVERYTHING)
def test_what_a_parser_is_offered_does_no_harm(name, laboratory, capsys):
    run = laboratory.fuzzed(name, SECONDS)
    with capsys.disabled():
        print("\n" + run.in_words(), end="")
    assert not run.failure, run.said[-6000:]
    assert run.executions > 100 and run.edges > 0, run.said[-6000:]
