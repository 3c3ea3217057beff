"""Tickwork beside the same diagrams by hand and in other frameworks: `python -m tests.peers`.

netlists    the diagrams, as data
by_hand     one straight line of plain Python, and of C
tickwork    native blocks and Python blocks
bdsim, drake, pathsim, python_can   other frameworks, where they are installed
agreement   each contender computes what the reference computes
"""
