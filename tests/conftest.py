"""Keep the objects of the test runner out of the garbage collection at the start of each run of a robot.

With the 300,000 objects of a session a collection takes 0.15 s. They are frozen. After every TESTS_BETWEEN_COLLECTIONS
tests the garbage among the newer objects is collected and the rest is frozen as well; what was frozen is collected
once in FULL_COLLECTION_INTERVAL of these collections.

Hypothesis draws the same examples in every session; with EXAMPLES=soak it draws others, and thirty times as many.
"""

import gc
import os

from hypothesis import settings

TESTS_BETWEEN_COLLECTIONS = 40
FULL_COLLECTION_INTERVAL = 20  # collections
finished = 0

settings.register_profile("steady", max_examples=30, derandomize=True, deadline=None)
settings.register_profile("soak", max_examples=1000, deadline=None)
settings.load_profile(os.environ.get("EXAMPLES", "steady"))


def pytest_collection_finish(session):
    collect(everything=True)


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
