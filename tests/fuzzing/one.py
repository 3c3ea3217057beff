"""Fuzz one target in this process, which tests/fuzzing/laboratory.py has started with libFuzzer in it: `python -m tests.fuzzing.one TARGET ARGUMENTS`."""

import sys

from tests.fuzzing.harness import drive
from tests.fuzzing.targets import TARGETS, Driven

drive(["tickwork", *sys.argv[2:]], Driven(TARGETS[sys.argv[1]]))
