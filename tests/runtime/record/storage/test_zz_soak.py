import os
import random
import time

from tests.runtime.record.storage.test_damage import *  # noqa
from tests.runtime.record.storage.test_damage import DAMAGES, check

KINDS = list(DAMAGES)


def test_soak(file):
    dice = random.Random(time.time_ns())
    until = time.monotonic() + float(os.environ.get("S", "150"))
    n = 0
    bad = []
    while time.monotonic() < until:
        at = dice.randrange(8, len(file.data) - 8)
        kind = dice.choice(KINDS)
        n += 1
        data = DAMAGES[kind](file.data, at)
        end = len(file.data) if kind in ("cut", "padded", "padded far") else at + (64 if kind == "sector" else 1)
        if kind == "removed":
            end = at + 1
        try:
            check(file, data, at, end, kind, thorough=dice.random() < 0.3)
        except BaseException as e:
            bad.append((at, kind, repr(e)[:300]))
            if len(bad) > 8:
                break
    print(n, bad)
    assert not bad, (n, bad)
