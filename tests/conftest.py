"""Keep the objects of the test runner out of the garbage collection at the start of each run of a robot.

With the 300,000 objects of a session a collection takes 0.15 s. They are frozen. After every TESTS_BETWEEN_COLLECTIONS
tests the garbage among the newer objects is collected and the rest is frozen as well; what was frozen is collected
once in FULL_COLLECTION_INTERVAL of these collections.

Hypothesis draws the same examples in every session; with EXAMPLES=soak it draws others, and 1000 of each.

With SKIPPED_FILES=error a session fails if every selected test of a file was skipped: a check whose tool is missing has
not been made. `make soak` sets it. Tests of real interfaces have a target of their own, `make test-hardware`.

A test that fails while the machine stands still is made again: `tests.repeating`.

Signals that the parent ignores, as under nohup, have their default action here and in every process that a test starts.
"""

import gc
import os
import signal

import pytest
from hypothesis import settings

from tests.repeating import Repeating

TESTS_BETWEEN_COLLECTIONS = 160
FULL_COLLECTION_INTERVAL = 5  # collections
finished = 0

for number, action in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, action)

settings.register_profile("steady", max_examples=15, derandomize=True, deadline=None)
settings.register_profile("soak", max_examples=1000, deadline=None)
settings.load_profile(os.environ.get("EXAMPLES", "steady"))


def pytest_configure(config):
    config.pluginmanager.register(Repeating())


def pytest_addoption(parser):
    parser.addoption("--rewrite", action="store_true", help="write the files of tests/golden instead of comparing them")


@pytest.fixture(scope="session")
def golden(request):
    from tests.golden import Golden

    return Golden(request.config.getoption("rewrite"))


def pytest_collection_finish(session):
    collect(everything=True)


ran, skipped = set(), {}  # files with a test that ran; reason by file with a test that was skipped
EXEMPT = ("tests/hardware/", "tests/peers/")


def pytest_runtest_logreport(report):
    note(report, report.nodeid.split("::")[0], report.when == "call" or report.failed)


def pytest_collectreport(report):
    if report.skipped:
        note(report, report.nodeid, False)


def note(report, file, has_run):
    if report.skipped:
        skipped[file] = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    elif has_run:
        ran.add(file)


def pytest_sessionfinish(session):
    if os.environ.get("SKIPPED_FILES") == "error":
        hidden = {file: why for file, why in skipped.items() if file not in ran and not file.startswith(EXEMPT)}
        for file, why in sorted(hidden.items()):
            print(f"\nERROR {file}: every test was skipped: {why}")
        if hidden:
            session.exitstatus = 1


def pytest_runtest_logfinish(nodeid, location):
    global finished
    finished += 1
    collections, rest = divmod(finished, TESTS_BETWEEN_COLLECTIONS)
    if rest == 0:
        collect(everything=collections % FULL_COLLECTION_INTERVAL == 0)


def collect(everything):
    if everything:
        gc.unfreeze()
    gc.collect()
    gc.freeze()
