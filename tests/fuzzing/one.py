"""`python -m tests.fuzzing.one TARGET ARGUMENTS`: fuzz it in this process, which the laboratory has started with
libFuzzer in it.
"""

import socket
import sys

from tests.fuzzing.targets import LINES_THAT_CARRY, TARGETS, Driven

name, words = sys.argv[1], ["tickwork", *sys.argv[2:]]
if name in TARGETS:
    from tests.fuzzing.harness import drive

    drive(words, Driven(TARGETS[name]))
else:
    from tests.fuzzing.lines import drive

    carrying = LINES_THAT_CARRY[name]
    ours, theirs = socket.socketpair(socket.AF_UNIX, carrying.socket)
    ours.setblocking(False)
    drive(words, carrying.kind, ours, theirs.fileno(), carrying.record)
