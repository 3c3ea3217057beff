"""Keep the objects of the test runner out of the garbage collection at the start of each run of a robot.

With the 300,000 objects of a session a collection takes 0.15 s. They are frozen, and the garbage of the tests is
collected after every TESTS_BETWEEN_COLLECTIONS tests.

Hypothesis draws the same examples in every session; with EXAMPLES=soak it draws others, and twenty times as many.
"""

import gc
import os

from hypothesis import settings

TESTS_BETWEEN_COLLECTIONS = 40
finished = 0

settings.register_profile("steady", max_examples=50, derandomize=True, deadline=None)
settings.register_profile("soak", max_examples=1000, deadline=None)
settings.load_profile(os.environ.get("EXAMPLES", "steady"))


def pytest_collection_finish(session):
    tidy()


def pytest_runtest_logfinish(nodeid, location):
    global finished
    finished += 1
    if finished % TESTS_BETWEEN_COLLECTIONS == 0:
        tidy()


def tidy():
    gc.unfreeze()
    gc.collect()
    gc.freeze()
