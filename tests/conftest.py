"""What all tests share: the garbage collector does not look through the test runner's own objects at each run of a
robot.

A run collects garbage before it begins. Among the 300,000 objects of a session that takes 0.15 s, hundreds of times; so
they are frozen, and what the tests themselves have left is collected after every few of them.
"""

import gc

EVERY = 40
finished = 0


def pytest_collection_finish(session):
    tidy()


def pytest_runtest_logfinish(nodeid, location):
    global finished
    finished += 1
    if finished % EVERY == 0:
        tidy()


def tidy():
    gc.unfreeze()
    gc.collect()
    gc.freeze()
