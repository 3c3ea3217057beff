"""The tests of safety can fail: each of many small errors, in what limits and what stops, is noticed by one of them."""

import os

import pytest

from tests.checkout import ROOT
from tests.mutation.equivalent import EQUIVALENT
from tests.mutation.laboratory import all_mutants, experiment, sampled
from tests.mutation.mutants import mutants
from tests.mutation.targets import TARGETS
from tests.mutation.test_removed_checks import CHECKS

SECONDS = float(os.environ.get("TICKWORK_MUTATION_SECONDS", 480))
LEFT_OUT_LIMIT = 4  # tests in real time, on a busy machine
SEED = int(os.environ.get("TICKWORK_MUTATION_SEED", 1))
SOURCE = '''
cdef int other(int a) noexcept nogil:
    return a + 1


cdef int limit(double x, bint on) noexcept nogil:
    """Not 3 and not < that."""
    cdef double high = 2.0      # 5 > 4
    if not on and x > high:
        x = (x -
             high)
    return <int>x
'''


def test_a_mutant_differs_from_its_source_in_one_error_of_the_named_function():
    found = mutants("a.pyx", SOURCE, ["limit"])
    assert [(mutant.line, mutant.before, mutant.after) for mutant in found] == [
        (8, "cdef double high = 2.0      # 5 > 4", "cdef double high = 3.0      # 5 > 4"),
        (9, "if not on and x > high:", "if not on and x >= high:"),
        (9, "if not on and x > high:", "if on and x > high:"),
        (9, "if not on and x > high:", "if not on or x > high:"),
        (10, "x = (x - high)", "pass"),
    ]
    assert all("return a + 1\n" in mutant.text and mutant.text != SOURCE for mutant in found)
    changed = [line for line in found[1].diff(SOURCE).splitlines()[2:] if line[0] in "+-"]
    assert changed == ["-    if not on and x > high:", "+    if not on and x >= high:"]


def test_a_function_that_does_not_exist_is_an_error():
    with pytest.raises(KeyError, match="limits"):
        mutants("a.pyx", SOURCE, ["limits"])


def test_a_sample_covers_every_file_first_in_an_order_given_by_the_seed():
    chosen = sampled(1)
    assert {mutant.file for _, mutant in chosen[: len(TARGETS)]} == {target.file for target in TARGETS}
    assert sampled(1) == chosen != sampled(2) and len(chosen) == len(all_mutants())


def test_modules_and_tests_of_every_target_exist():
    files = {f"{module}.pyx" for target in TARGETS for module in target.modules}
    files |= {test for target in TARGETS for test in target.tests}
    assert [file for file in sorted(files) if not (ROOT / file).is_file()] == []


def test_every_check_that_is_removed_is_still_in_its_file():
    places = {name: (ROOT / check.file).read_text().count(check.before) for name, check in CHECKS.items()}
    assert places == dict.fromkeys(CHECKS, 1)


def test_every_listed_equivalent_mutant_still_exists():
    names = {
        mutant.name
        for target in TARGETS
        for mutant in mutants(target.file, (ROOT / target.file).read_text(), target.functions)
    }
    assert not EQUIVALENT.keys() - names, "take out what is no mutant any more"
    assert all(EQUIVALENT.values())


@pytest.mark.soak
def test_every_mutant_is_killed(capsys):
    verdicts, survivors = experiment(SECONDS, SEED)
    tried = sum(verdicts[each] for each in ("killed", "survived", "no answer", "no program"))
    with capsys.disabled():
        print(
            f"\nmutants: {verdicts['made']} there are, {tried} tried, {verdicts['killed']} killed, "
            f"{verdicts['survived']} survived, {verdicts['no answer']} no answer, {verdicts['no program']} no program; "
            f"{verdicts['left out']} tests left out, as they fail without a mutant"
        )
    assert verdicts["killed"] > 0 and verdicts["left out"] <= LEFT_OUT_LIMIT
    assert not survivors, "\n\n".join(mutant.diff((ROOT / mutant.file).read_text()) for mutant in survivors)
