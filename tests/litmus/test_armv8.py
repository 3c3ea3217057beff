"""The model against the verdicts of herd7 7.57 (aarch64.cat) on classic tests. `herd_text` writes them for herd7."""

import itertools

import pytest

from tests.litmus.armv8 import (
    ACQUIRE,
    IN_ORDER,
    RELAXED,
    RELEASE,
    exchange,
    fence_acquire,
    fence_release,
    load,
    outcomes,
    store,
    swap,
)


def program(*accesses):
    """A thread that notes what each of its loads returns, under the name of a register."""

    def thread(memory):
        for register, access in accesses:
            value = yield access
            if register:
                memory[register] = int(value)

    return thread


def w(place, value, order=RELAXED):
    return None, store(place, value, order)


def r(register, place, order=RELAXED):
    return register, load(place, order)


READ, WRITE = (None, fence_acquire()), (None, fence_release())
# name: (threads, what the registers and words would be in the end, whether herd7 allows it)
CLASSICS = {
    "MP": ([[w("x", 1), w("y", 1)], [r("a", "y"), r("b", "x")]], {"a": 1, "b": 0}, True),
    "MP+rel+acq": ([[w("x", 1), w("y", 1, RELEASE)], [r("a", "y", ACQUIRE), r("b", "x")]], {"a": 1, "b": 0}, False),
    "MP+rel+po": ([[w("x", 1), w("y", 1, RELEASE)], [r("a", "y"), r("b", "x")]], {"a": 1, "b": 0}, True),
    "MP+po+acq": ([[w("x", 1), w("y", 1)], [r("a", "y", ACQUIRE), r("b", "x")]], {"a": 1, "b": 0}, True),
    "MP+dmb+dmbld": ([[w("x", 1), WRITE, w("y", 1)], [r("a", "y"), READ, r("b", "x")]], {"a": 1, "b": 0}, False),
    "SB": ([[w("x", 1), r("a", "y")], [w("y", 1), r("b", "x")]], {"a": 0, "b": 0}, True),
    "SB+rel+acq": (
        [[w("x", 1, RELEASE), r("a", "y", ACQUIRE)], [w("y", 1, RELEASE), r("b", "x", ACQUIRE)]],
        {"a": 0, "b": 0},
        True,
    ),
    "SB+inorder": (
        [[w("x", 1, IN_ORDER), r("a", "y", IN_ORDER)], [w("y", 1, IN_ORDER), r("b", "x", IN_ORDER)]],
        {"a": 0, "b": 0},
        False,
    ),
    "SB+inorder+rel": (
        [[w("x", 1, IN_ORDER), r("a", "y", IN_ORDER)], [w("y", 1, RELEASE), r("b", "x", ACQUIRE)]],
        {"a": 0, "b": 0},
        True,
    ),
    "SB+dmbs": ([[w("x", 1), WRITE, r("a", "y")], [w("y", 1), WRITE, r("b", "x")]], {"a": 0, "b": 0}, False),
    "SB+dmblds": ([[w("x", 1), READ, r("a", "y")], [w("y", 1), READ, r("b", "x")]], {"a": 0, "b": 0}, True),
    "SB+swaps": (
        [[("p", exchange("x", 1)), r("a", "y", ACQUIRE)], [("q", exchange("y", 1)), r("b", "x", ACQUIRE)]],
        {"a": 0, "b": 0},
        True,
    ),
    "LB": ([[r("a", "x"), w("y", 1)], [r("b", "y"), w("x", 1)]], {"a": 1, "b": 1}, True),
    "LB+acqs": ([[r("a", "x", ACQUIRE), w("y", 1)], [r("b", "y", ACQUIRE), w("x", 1)]], {"a": 1, "b": 1}, False),
    "LB+rels": ([[r("a", "x"), w("y", 1, RELEASE)], [r("b", "y"), w("x", 1, RELEASE)]], {"a": 1, "b": 1}, False),
    "2+2W": ([[w("x", 1), w("y", 2)], [w("y", 1), w("x", 2)]], {"x": 1, "y": 1}, True),
    "2+2W+rels": ([[w("x", 1), w("y", 2, RELEASE)], [w("y", 1), w("x", 2, RELEASE)]], {"x": 1, "y": 1}, False),
    "R+rel+acq": (
        [[w("x", 1), w("y", 1, RELEASE)], [w("y", 2, RELEASE), r("a", "x", ACQUIRE)]],
        {"y": 2, "a": 0},
        True,
    ),
    "R+rel+inorder": (
        [[w("x", 1), w("y", 1, RELEASE)], [w("y", 2, IN_ORDER), r("a", "x", IN_ORDER)]],
        {"y": 2, "a": 0},
        False,
    ),
    "S+rel+acq": ([[w("x", 2), w("y", 1, RELEASE)], [r("a", "y", ACQUIRE), w("x", 1)]], {"a": 1, "x": 2}, False),
    "S+rel+po": ([[w("x", 2), w("y", 1, RELEASE)], [r("a", "y"), w("x", 1)]], {"a": 1, "x": 2}, True),
    "IRIW+acqs": (
        [
            [w("x", 1)],
            [w("y", 1)],
            [r("a", "x", ACQUIRE), r("b", "y", ACQUIRE)],
            [r("c", "y", ACQUIRE), r("d", "x", ACQUIRE)],
        ],
        {"a": 1, "b": 0, "c": 1, "d": 0},
        False,
    ),
    "IRIW": (
        [[w("x", 1)], [w("y", 1)], [r("a", "x"), r("b", "y")], [r("c", "y"), r("d", "x")]],
        {"a": 1, "b": 0, "c": 1, "d": 0},
        True,
    ),
    "WRC+po+acq": (
        [[w("x", 1)], [r("a", "x"), w("y", 1, RELEASE)], [r("b", "y", ACQUIRE), r("c", "x")]],
        {"a": 1, "b": 1, "c": 0},
        False,
    ),
    "WRC+po+po": (
        [[w("x", 1)], [r("a", "x"), w("y", 1)], [r("b", "y", ACQUIRE), r("c", "x")]],
        {"a": 1, "b": 1, "c": 0},
        True,
    ),
    "CoRR": ([[w("x", 1)], [r("a", "x"), r("b", "x")]], {"a": 1, "b": 0}, False),
    "CoWR": ([[w("x", 1), r("a", "x")], [w("x", 2)]], {"a": 0}, False),
    "two swaps": ([[("a", exchange("x", 1))], [("b", exchange("x", 2))]], {"a": 0, "b": 0}, False),
    "swap+MP": (
        [[w("x", 1), ("p", exchange("y", 1))], [("a", exchange("y", 2)), r("b", "x")]],
        {"a": 1, "b": 0},
        False,
    ),
    "swap forwards": (
        [[("p", exchange("x", 1)), r("a", "x", ACQUIRE), r("b", "y")], [("q", exchange("y", 1)), r("c", "x")]],
        {"a": 1, "b": 0, "c": 0},
        True,
    ),
}


def allows(name):
    threads, wanted, _ = CLASSICS[name]
    return any(
        wanted.items() <= {**memory, **notes}.items() for notes, memory in outcomes(*(program(*t) for t in threads))
    )


@pytest.mark.parametrize("name", CLASSICS)
def test_a_classic_has_the_verdict_of_herd(name):
    assert allows(name) == CLASSICS[name][2]


def test_compare_and_swap_succeeds_once():
    def thread(name):
        def run(memory):
            memory[name] = yield swap("word", 0, 1)

        return run

    found = [(notes["a"], notes["b"]) for notes, _ in outcomes(thread("a"), thread("b"))]
    assert sorted(found) == [(False, True), (True, False)]


def herd_text(name):
    """A classic in the format of herd7 for AArch64: `herd7 FILE` prints Ok if the outcome is allowed."""
    threads, wanted, _ = CLASSICS[name]
    loads = {RELAXED: "LDR", ACQUIRE: "LDAPR", IN_ORDER: "LDAR"}
    stores = {RELAXED: "STR", RELEASE: "STLR", IN_ORDER: "STLR"}
    columns, registers, places = [], {}, set()
    for number, thread in enumerate(threads):
        lines = []
        free = (f"W{n}" for n in itertools.count(10))
        for register, access in thread:
            if access[0] == "fence":
                lines.append("DMB ISHLD" if access[1] == ACQUIRE else "DMB ISH")
                continue
            places.add(access[1])
            at = f"[X{'xy'.index(access[1])}]"
            target = next(free)
            if register:
                registers[register] = f"{number}:X{target[1:]}"
            if access[0] == "load":
                lines.append(f"{loads[access[2]]} {target},{at}")
            elif access[0] == "store":
                lines += [f"MOV {target},#{access[2]}", f"{stores[access[3]]} {target},{at}"]
            else:
                value, failed = next(free), next(free)
                lines += [f"LDAXR {target},{at}", f"MOV {value},#{access[2]}", f"STLXR {failed},{value},{at}"]
                registers[f"failed{number}"] = f"{number}:X{failed[1:]}"
        columns.append(lines)
    rows = [[f"P{number}" for number in range(len(columns))], *itertools.zip_longest(*columns, fillvalue="")]
    initial = " ".join(f"{n}:X{'xy'.index(p)}={p};" for n in range(len(columns)) for p in sorted(places))
    final = [f"{registers[key]}={value}" if key in registers else f"[{key}]={value}" for key, value in wanted.items()]
    final += [f"{place}=0" for key, place in registers.items() if key.startswith("failed")]
    body = "\n".join(" | ".join(row) + " ;" for row in rows)
    condition = " /\\ ".join(final)
    title = name.replace(" ", "-").replace("+", "-")
    return f"AArch64 {title}\n{{ {initial} }}\n{body}\nexists ({condition})\n"
