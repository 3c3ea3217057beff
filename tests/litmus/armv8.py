"""Exhaustive check of small programs of several threads in the memory model of Armv8, the weakest that we run on.

A thread is a generator that yields its accesses and receives what they load:

    def reader(memory):
        if (yield load("flag", ACQUIRE)):
            memory["seen"] = yield load("data")

`outcomes` returns every combination of what the threads have noted and of the final memory that the model allows. The
model is the axiomatic one of the Arm Architecture Reference Manual (Deacon, aarch64.cat; Pulte et al., "Simplifying ARM
concurrency", 2018): each execution is a choice of the store that every load reads and of the order of the stores to
each word; it is allowed if it is coherent at every word, its read-modify-writes are atomic, and the order of
observations, barriers and acquire and release accesses has no cycle.

An instruction is assumed to be the weakest that a compiler may choose: `ldapr` for acquire, pairs of `ldaxr` and
`stlxr` for read-modify-writes, and no order by dependencies. What is proved here holds on every Armv8, and on x86-64.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field, replace

RELAXED, ACQUIRE, RELEASE, IN_ORDER = "relaxed", "acquire", "release", "in order"
EXCLUSIVE = "exclusive"  # `ldaxr`
ACQUIRING = ACQUIRE, IN_ORDER, EXCLUSIVE  # of a load
Thread = Callable[[dict], Generator]


@dataclass(frozen=True)
class Event:
    """One access. kind : R, W or F. order : of cext/atomics.pxd. pair : position of the load of a read-modify-write"""

    kind: str
    place: str = ""
    value: int = 0
    order: str = RELAXED
    pair: int = -1
    thread: int = -1


def load(place, order=RELAXED):
    return "load", place, order


def store(place, value, order=RELAXED):
    return "store", place, value, order


def fence_acquire():
    """`dmb ishld`"""
    return "fence", ACQUIRE


def fence_release():
    """`dmb ish`"""
    return "fence", RELEASE


def swap(place, old, new):
    """Compare-and-swap that acquires and releases. Yields whether it has succeeded."""
    return "swap", place, old, new


def exchange(place, new):
    """Yields the old value."""
    return "exchange", place, new


@dataclass
class Trace:
    events: list[Event] = field(default_factory=list)
    notes: dict = field(default_factory=dict)


class TooMany(Exception):
    """A thread reads more than the limit: its loop needs a bound."""


def run(thread: Thread, values: tuple[int, ...]) -> tuple[Trace, str | None]:
    """Run a thread with the values of its loads. Returns its Trace, and the place of its next load, None at its end."""
    trace, given = Trace(), iter(values)
    steps = thread(trace.notes)
    answer = None
    while True:
        try:
            step = steps.send(answer)
        except StopIteration:
            return trace, None
        kind, answer = step[0], None
        if kind == "fence":
            trace.events.append(Event("F", order=step[1]))
        elif kind == "store":
            trace.events.append(Event("W", step[1], step[2], step[3]))
        else:
            value = next(given, None)
            if value is None:
                return trace, step[1]
            order = step[2] if kind == "load" else EXCLUSIVE
            trace.events.append(Event("R", step[1], value, order))
            answer = value if kind != "swap" else value == step[2]
            if kind == "exchange" or (kind == "swap" and answer):
                trace.events.append(Event("W", step[1], step[-1], RELEASE, len(trace.events) - 1))


def traces(thread: Thread, domain: dict[str, set[int]]) -> Iterator[Trace]:
    """Every trace of a thread whose loads return values of the domain."""
    waiting = [()]
    while waiting:
        values = waiting.pop()
        if len(values) > 12:
            raise TooMany
        trace, place = run(thread, values)
        if place is None:
            yield trace
        else:
            waiting += [(*values, value) for value in sorted(domain.setdefault(place, {0}))]


def is_acyclic(edges: list[set[int]]) -> bool:
    degree = [0] * len(edges)
    for targets in edges:
        for target in targets:
            degree[target] += 1
    ready = [node for node, count in enumerate(degree) if count == 0]
    done = 0
    while ready:
        done += 1
        for target in edges[ready.pop()]:
            degree[target] -= 1
            if degree[target] == 0:
                ready.append(target)
    return done == len(edges)


def is_ordered(events: list[Event], i: int, j: int) -> bool:
    """Return whether two accesses of one thread, in this order, are locally ordered (bob and aob of the model)."""
    first, second = events[i], events[j]
    between = events[i + 1 : j]
    if first.order in ACQUIRING and first.kind == "R":
        return True  # [A|Q]; po
    if second.order in (RELEASE, IN_ORDER) and second.kind == "W":
        return True  # po; [L]
    if first.kind == "W" and first.order in (RELEASE, IN_ORDER) and second.kind == "R":
        if second.order in (IN_ORDER, EXCLUSIVE):
            return True  # [L]; po; [A], not with [Q]
    if any(event.kind == "F" and event.order == RELEASE for event in between):
        return True
    if first.kind == "R" and any(event.kind == "F" for event in between):
        return True
    return second.pair == i  # rmw


def choices(events: list[Event], place: str, initial: int) -> Iterator[tuple[list[tuple[int, int]], dict[int, int]]]:
    """Yield the coherent (order of stores, store that each load reads) of a word; -1 is its initial value."""
    here = [number for number, event in enumerate(events) if event.place == place]
    writes = [number for number in here if events[number].kind == "W"]
    reads = [number for number in here if events[number].kind == "R"]
    sources = [[w for w in (-1, *writes) if (initial if w < 0 else events[w].value) == events[r].value] for r in reads]
    for order in itertools.permutations(writes):
        rank = {-1: -1, **{write: position for position, write in enumerate(order)}}
        for chosen in itertools.product(*sources):
            read = dict(zip(reads, chosen))
            if is_coherent(events, here, rank, read) and is_atomic(events, rank, read):
                yield order, read


def is_coherent(events, here, rank, read) -> bool:
    """Along each thread the accesses to a word go forward in the order of its stores."""
    for i, j in itertools.combinations(here, 2):
        if events[i].thread != events[j].thread:
            continue
        one, other = (rank[n] if events[n].kind == "W" else rank[read[n]] for n in (i, j))
        if one > other or (events[j].kind == "W" and one == other):
            return False
        if events[i].kind == "R" and read[i] == j:
            return False
    return True


def is_atomic(events, rank, read) -> bool:
    """No store comes between the load and the store of a read-modify-write."""
    return all(
        rank[number] == rank[read[event.pair]] + 1
        for number, event in enumerate(events)
        if event.pair >= 0 and number in rank
    )


def outcomes(
    *threads: Thread, suspicious: Callable[[dict], bool] = lambda notes: True, initial: dict[str, int] | None = None
) -> list[tuple[dict, dict]]:
    """Return every allowed (notes of all threads, final memory), once each.

    suspicious : whether an outcome with these notes is of interest; the search leaves out the others
    initial : words that are not 0 at the start
    """
    initial = initial or {}
    domain = {place: {value} for place, value in initial.items()}
    while True:  # until no thread stores a value that is new
        found = [list(traces(thread, domain)) for thread in threads]
        writes = [event for ready in found for trace in ready for event in trace.events if event.kind == "W"]
        new = [event for event in writes if event.value not in domain.get(event.place, ())]
        if not new:
            break
        for event in new:
            domain.setdefault(event.place, {initial.get(event.place, 0)}).add(event.value)
    result: list[tuple[dict, dict]] = []
    for combination in itertools.product(*found):
        notes = {key: value for trace in combination for key, value in trace.notes.items()}
        if suspicious(notes):
            for memory in executions(combination, initial):
                if (notes, memory) not in result:
                    result.append((notes, memory))
    return result


def executions(combination, initial: dict[str, int]) -> Iterator[dict]:
    """Yield the final memory of every allowed execution of these traces."""
    events: list[Event] = []
    for number, trace in enumerate(combination):
        base = len(events)
        events += [replace(e, thread=number, pair=e.pair + base if e.pair >= 0 else -1) for e in trace.events]
    edges: list[set[int]] = [set() for _ in events]
    for i, j in itertools.combinations(range(len(events)), 2):
        if events[i].thread == events[j].thread and "F" not in (events[i].kind, events[j].kind):
            if is_ordered(events, i, j):
                edges[i].add(j)
    places = sorted({event.place for event in events if event.place})
    options = []
    for place in places:
        options.append(list(choices(events, place, initial.get(place, 0))))
        if not options[-1]:
            return
    for chosen in itertools.product(*options):
        observed = [set(targets) for targets in edges]
        for order, read in chosen:
            rank = {-1: -1, **{write: position for position, write in enumerate(order)}}
            for i, j in itertools.combinations(order, 2):
                if events[i].thread != events[j].thread:
                    observed[i].add(j)  # coe
            for reader, source in read.items():
                if source >= 0 and events[source].thread != events[reader].thread:
                    observed[source].add(reader)  # rfe
                elif (
                    source >= 0
                    and events[source].pair >= 0
                    and events[reader].order in (ACQUIRE, IN_ORDER, "exclusive")
                ):
                    observed[source].add(reader)  # [range(rmw)]; rfi; [A|Q]
                for write in order:
                    if rank[write] > rank[source] and events[write].thread != events[reader].thread:
                        observed[reader].add(write)  # fre
        if is_acyclic(observed):
            yield {
                place: events[order[-1]].value if order else initial.get(place, 0)
                for place, (order, _) in zip(places, chosen)
            }
