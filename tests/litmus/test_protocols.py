"""The protocols between threads and processes, transcribed and checked in every execution that Armv8 allows.

Each transcription names the functions that it follows. Where a protocol needs an order, the same test is made without
it, and must find the fault: a transcription that could not fail does not pass.
"""

import pytest

from tests.litmus.armv8 import (
    ACQUIRE,
    IN_ORDER,
    RELAXED,
    RELEASE,
    fence_acquire,
    fence_release,
    load,
    outcomes,
    store,
    swap,
)

# cext/kernels/networks/worker.pyx: the thread sleeps for lack of work


def submitter(stores, loads):
    """`submit`: a job, then the word if the thread may sleep."""

    def thread(memory):
        yield store("submitted", 1, stores)
        memory["wakes"] = (yield load("work", loads)) == 0
        if memory["wakes"]:
            yield store("work", 1, RELEASE)

    return thread


def worker(stores, loads):
    """`enter`: clear the word, look for a job or the end, then sleep while the word is 0."""

    def thread(memory):
        yield store("work", 0, stores)
        memory["saw"] = yield load("submitted", loads)
        memory["left"] = yield load("leave", loads)

    return thread


def ender(stores):
    """`end_thread`: the end, then the word, then the call of the kernel that wakes."""

    def thread(memory):
        yield store("leave", 1, stores)
        yield store("work", 2, stores)

    return thread


def sleeps_for_good(stores, loads):
    """Whether the thread may sleep though a job is there, and nobody wakes it: the word is 0 in the end."""
    found = outcomes(
        submitter(stores, loads), worker(stores, loads), initial={"work": 1}, suspicious=lambda notes: not notes["saw"]
    )
    return any(memory["work"] == 0 and not notes["wakes"] for notes, memory in found)


def test_a_thread_of_a_network_does_not_miss_a_job():
    assert not sleeps_for_good(IN_ORDER, IN_ORDER)


@pytest.mark.parametrize("stores, loads", [(RELEASE, ACQUIRE), (IN_ORDER, ACQUIRE), (RELAXED, RELAXED)])
def test_a_thread_of_a_network_could_miss_a_job_without_sequential_consistency(stores, loads):
    assert sleeps_for_good(stores, loads)


def test_a_thread_of_a_network_does_not_miss_its_end():
    found = outcomes(ender(IN_ORDER), worker(IN_ORDER, IN_ORDER), suspicious=lambda notes: not notes["left"])
    assert all(memory["work"] == 2 for _, memory in found)
    found = outcomes(ender(RELEASE), worker(RELEASE, ACQUIRE), suspicious=lambda notes: not notes["left"])
    assert any(memory["work"] == 0 for _, memory in found)


# cext/kernels/networks/worker.pyx: the loop waits for a result in virtual time


def finisher(order):
    def thread(memory):
        yield store("done", 1, order)
        yield store("result", 1, order)

    return thread


def waiter(stores, loads):
    """`wait_for`: the word was 1 of an earlier result."""

    def thread(memory):
        yield store("result", 0, stores)
        memory["saw"] = yield load("done", loads)

    return thread


@pytest.mark.parametrize("stores, loads, misses", [(IN_ORDER, IN_ORDER, False), (RELEASE, ACQUIRE, True)])
def test_the_loop_does_not_miss_a_result(stores, loads, misses):
    found = outcomes(finisher(stores), waiter(stores, loads), suspicious=lambda notes: not notes["saw"])
    assert any(memory["result"] == 0 for _, memory in found) == misses


# cext/memory/shared_state.pxd: `reserve` and `commit` of the ring of the recording; cext/ring/keys.pxd, rings.pyx alike


def producer(order):
    """Two records in a ring of one: the second when the reader has released the first."""

    def thread(memory):
        yield store("record", 1)
        yield store("head", 1, order)
        if (yield load("tail", ACQUIRE)) == 1:
            yield store("record", 2)
            yield store("head", 2, order)

    return thread


def consumer(order, tail):
    """`SharedState.drain`"""

    def thread(memory):
        memory["head"] = yield load("head", order)
        if memory["head"]:
            memory["read"] = yield load("record")
            yield store("tail", 1, tail)

    return thread


@pytest.mark.parametrize(
    "commit, look, release, torn",
    [
        (RELEASE, ACQUIRE, RELEASE, False),
        (RELAXED, ACQUIRE, RELEASE, True),
        (RELEASE, RELAXED, RELEASE, True),
        (RELEASE, ACQUIRE, RELAXED, True),
    ],
)
def test_a_reader_of_the_recording_finds_the_record_that_was_committed(commit, look, release, torn):
    found = outcomes(producer(commit), consumer(look, release), suspicious=lambda notes: notes["head"] == 1)
    assert any(notes["read"] != 1 for notes, _ in found) == torn


# cext/ring/newest_ring.pxd: `push` and `pull`, a ring of one place


def writer(fences):
    def thread(memory):
        for number in (1, 2):
            yield store("claimed", number, RELEASE)
            if fences:
                yield fence_release()
            yield store("one", number)
            yield store("other", number)
            yield store("head", number, RELEASE)

    return thread


def puller(fences):
    def thread(memory):
        memory["head"] = yield load("head", ACQUIRE)
        if memory["head"]:
            memory["one"] = yield load("one")
            memory["other"] = yield load("other")
            if fences:
                yield fence_acquire()
            memory["claimed"] = yield load("claimed", ACQUIRE)

    return thread


@pytest.mark.parametrize("writes, reads, torn", [(True, True, False), (False, True, True), (True, False, True)])
def test_a_reader_of_the_newest_frames_discards_a_torn_copy(writes, reads, torn):
    found = outcomes(
        writer(writes), puller(reads), suspicious=lambda notes: notes["head"] == 1 and notes["claimed"] == 1
    )
    assert any((notes["one"], notes["other"]) != (1, 1) for notes, _ in found) == torn


# cext/ring/mailbox.pxd: `take_oldest`, `answer`; cext/schedule/mailbox_writer.pyx: `post`, `answer`, `withdraw`

FREE, POSTED, READING, ANSWERED = 0, 2, 3, 4
SECOND = 10  # of the next use of a letter


def poster(order, withdraws):
    """Posts a letter; takes it back and posts another one, or waits for the answer."""

    def thread(memory):
        yield store("value", 1)
        yield store("state", POSTED, order)
        if withdraws:
            memory["withdrawn"] = yield swap("state", POSTED, FREE)
            if memory["withdrawn"]:
                yield store("value", 2)
                yield store("state", SECOND + POSTED, order)
        elif (yield load("state", ACQUIRE)) == ANSWERED:
            memory["answer"] = yield load("answer")

    return thread


def taker(memory):
    """The word is loaded, and the letter copied after the swap of that word."""
    state = yield load("state", ACQUIRE)
    if state % SECOND == POSTED and (yield swap("state", state, state - POSTED + READING)):
        memory["taken"] = state
        memory["copy"] = yield load("value")
        yield store("answer", 7)
        yield store("state", state - POSTED + ANSWERED, RELEASE)


def test_the_loop_carries_out_the_letter_that_it_has_taken():
    for withdraws in (False, True):
        found = outcomes(poster(RELEASE, withdraws), taker, suspicious=lambda notes: "taken" in notes)
        assert {notes["copy"] for notes, _ in found if notes["taken"] == POSTED} == {1}
        assert {notes["copy"] for notes, _ in found if notes["taken"] != POSTED} == ({2} if withdraws else set())
        assert not any(notes.get("withdrawn") and notes["taken"] == POSTED for notes, _ in found)
        assert all(notes["answer"] == 7 for notes, _ in found if "answer" in notes)
    found = outcomes(poster(RELAXED, False), taker, suspicious=lambda notes: "taken" in notes)
    assert any(notes["copy"] != 1 for notes, _ in found)


def counter_writer(memory):
    """`post`: the letter, then the number of posts, on which an idle loop looks."""
    yield store("state", POSTED, RELEASE)
    yield swap("posted", 0, 1)


def idle_loop(memory):
    """`LiveTable.take`: it keeps the number that it has read before it has looked at the letters."""
    memory["seen"] = yield load("posted", ACQUIRE)
    memory["found"] = yield load("state", ACQUIRE)


def test_an_idle_loop_does_not_overlook_a_letter():
    assert all(notes["found"] for notes, _ in outcomes(counter_writer, idle_loop) if notes["seen"])


# cext/ring/operator.pxd: `consent_to` and `take_consent`


def consenter(number):
    """The confirmation of one question, in one word."""

    def thread(memory):
        yield store("process", number, RELEASE)
        yield store("consent", number, RELEASE)

    return thread


def asker(name):
    """It takes the newest confirmation, once."""

    def thread(memory):
        consent = yield load("consent", ACQUIRE)
        if consent and (yield swap("consent", consent, 0)):
            memory[name] = consent
            memory["process"] = yield load("process")

    return thread


def test_a_confirmation_is_taken_once_and_whole():
    found = outcomes(consenter(1), asker("first"), asker("second"))
    assert not any("first" in notes and "second" in notes for notes, _ in found)
    assert any("first" in notes for notes, _ in found)
    assert all(notes["process"] == 1 for notes, _ in found if "process" in notes)
    found = outcomes(consenter(1), consenter(2), asker("first"))
    assert {notes["first"] for notes, _ in found if "first" in notes} == {1, 2}


# cext/schedule/handover.pxd: the loop and the watchdog

LOOP, UNOWNED, WATCHDOG = 0, 1, 2


def ticking(order):
    """`Tick.run`: use the devices, release them around a step, and use them again if they were not taken."""

    def thread(memory):
        yield store("device", 1)
        yield store("user", UNOWNED, order)
        memory["loop"] = yield swap("user", UNOWNED, LOOP)
        if memory["loop"]:
            memory["loop_device"] = yield load("device")
            yield store("device", 2)

    return thread


def watching(memory):
    """`Watchdog.stop`: begin the stop once the devices are taken."""
    memory["watchdog"] = yield swap("user", UNOWNED, WATCHDOG)
    if memory["watchdog"]:
        memory["watchdog_device"] = yield load("device")
        yield store("device", 3)


def test_devices_have_one_owner():
    found = outcomes(ticking(RELEASE), watching)
    assert {(notes["loop"], notes["watchdog"]) for notes, _ in found} == {(True, False), (False, True)}
    assert {notes["watchdog_device"] for notes, _ in found if notes["watchdog"]} == {1}
    assert {notes["loop_device"] for notes, _ in found if notes["loop"]} == {1}
    assert {memory["device"] for notes, memory in found if notes["watchdog"]} == {3}
    found = outcomes(ticking(RELAXED), watching)
    assert any(notes["watchdog_device"] == 0 for notes, _ in found if notes["watchdog"])


# cext/safety: the fence. The guardian raises it for good; the loop raises and lowers its own

HERE, FOR_GOOD = 1, 2


def guardian(memory):
    """`SharedState.raise_fence`, then the frames of the stop."""
    yield store("fence", FOR_GOOD, RELEASE)


def looping(memory):
    """`Publisher.raise_fence` at a fault, `lower_fence` to arm again, then the check in front of a command."""
    yield swap("fence", 0, HERE)
    memory["armed"] = yield swap("fence", HERE, 0)
    memory["sends"] = (yield load("fence", ACQUIRE)) == 0


def test_the_fence_of_the_guardian_is_never_lowered():
    found = outcomes(guardian, looping)
    assert {memory["fence"] for _, memory in found} == {FOR_GOOD}
    assert not any(notes["sends"] and not notes["armed"] for notes, _ in found)
    assert any(notes["sends"] for notes, _ in found)


def reporting(memory):
    """The guardian tells, after the fence, when it has raised it."""
    yield store("fence", FOR_GOOD, RELEASE)
    yield store("stopped", 1, RELEASE)


def sending(memory):
    """`Buses.send`: once the stop of the guardian was seen, the fence is seen as well, and no batch follows."""
    memory["stopped"] = yield load("stopped", ACQUIRE)
    memory["sends"] = (yield load("fence", ACQUIRE)) == 0


def test_a_batch_whose_fence_is_checked_after_the_stop_is_not_sent():
    """A batch that was checked before may follow the stop: one of each bus, which the next round of the stop ends."""
    assert not any(notes["stopped"] and notes["sends"] for notes, _ in outcomes(reporting, sending))
