"""The ring and the counters of the shared state: order, wrap-around, drops, a second process, percentiles."""

import os
import random
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cext.clock.histogram import percentiles
from cext.memory.shared_state import RECORD_EVENT, RECORD_FRAME, RECORD_ROW, SharedState
from tests.runtime.runs import open_files


def payload(number, words):
    return number.to_bytes(8, "little") * words


def test_records_are_drained_in_order_with_kind():
    shared = SharedState(4096)
    for number, kind in enumerate((RECORD_ROW, RECORD_FRAME, RECORD_EVENT)):
        assert shared.push(kind, payload(number, 1))
    assert shared.drain() == [(RECORD_ROW, payload(0, 1)), (RECORD_FRAME, payload(1, 1)), (RECORD_EVENT, payload(2, 1))]
    assert shared.drain() == [] and shared.empty


def test_payload_is_padded_to_whole_words():
    shared = SharedState(4096)
    shared.push(RECORD_EVENT, b'{"a": 1}' + b"!")
    shared.push(RECORD_EVENT, b"")
    assert shared.drain() == [(RECORD_EVENT, b'{"a": 1}!       '), (RECORD_EVENT, b"")]


def test_capacity_is_rounded_up_to_a_power_of_two():
    shared = SharedState(5000)
    pushed = 0
    while shared.push(RECORD_ROW, bytes(56)):
        pushed += 1
    assert (
        pushed == 8192 // 64
        and SharedState(1).push(RECORD_ROW, bytes(4088))
        and not SharedState(1).push(RECORD_ROW, bytes(4096))
    )


def test_a_full_ring_rejects_records_until_it_is_read():
    shared = SharedState(4096)
    pushed = sum(shared.push(RECORD_ROW, payload(number, 7)) for number in range(100))
    assert pushed == 64
    assert [kind for kind, _ in shared.drain(3)] == [RECORD_ROW] * 3
    assert [shared.push(RECORD_ROW, payload(200 + number, 7)) for number in range(4)] == [True, True, True, False]
    numbers = [int.from_bytes(record[:8], "little") for _, record in shared.drain()]
    assert numbers == [*range(3, 64), 200, 201, 202]


def test_a_record_is_never_cut_at_the_end_of_the_ring():
    shared = SharedState(4096)
    for lap in range(200):
        assert shared.push(RECORD_ROW, payload(lap, 100)), lap  # 808 bytes do not divide 4096
        assert shared.drain() == [(RECORD_ROW, payload(lap, 100))]


@given(st.lists(st.one_of(st.integers(0, 300), st.just("drain")), max_size=200), st.integers(1, 20))
def test_accepted_records_are_drained_once_and_in_order(actions, most):
    shared = SharedState(4096)
    taken, out = [], []
    for number, action in enumerate(actions):
        if action == "drain":
            out += shared.drain(most)
            continue
        record = payload(number, action)
        if shared.push(RECORD_ROW, record):
            taken.append((RECORD_ROW, record))
    while not shared.empty:
        out += shared.drain(most)
    assert out == taken


READER = """
import sys
from cext.memory.shared_state import SharedState
shared = SharedState(fd=int(sys.argv[1]))
expected = count = 0
while True:
    closed = shared.closed
    for kind, record in shared.drain(64):
        number = int.from_bytes(record[:8], "little")
        assert number >= expected and len(record) == 8 * (number % 37 + 1)
        assert record == number.to_bytes(8, "little") * (len(record) // 8)
        expected, count = number + 1, count + 1
    if closed and shared.empty:
        break
print(count)
"""


def test_another_process_reads_every_record_whole_and_in_order_while_this_one_writes():
    shared = SharedState(1 << 14)
    reader = subprocess.Popen(
        [sys.executable, "-c", READER, str(shared.fd)], pass_fds=[shared.fd], stdout=subprocess.PIPE, text=True
    )
    pushed = refused = 0
    for number in range(100_000):
        if shared.push(RECORD_ROW, payload(number, number % 37 + 1)):
            pushed += 1
        else:
            refused += 1
            os.sched_yield()
    shared.close()
    text, _ = reader.communicate(timeout=60)
    assert reader.returncode == 0 and int(text) == pushed
    assert pushed + refused == 100_000 and pushed > 1000


def test_all_mappings_of_the_shared_state_share_memory():
    shared = SharedState(4096)
    other = SharedState(fd=shared.fd)
    other.raise_fence()
    shared.close()
    assert shared.fenced and other.closed and shared.state == other.state == "init"
    shared.push(RECORD_EVENT, b"12345678")
    assert other.drain() == [(RECORD_EVENT, b"12345678")] and shared.empty


def test_file_without_shared_state_is_refused(tmp_path):
    for content in (b"short", bytes(100_000)[:-8] + b"whatever"):
        file = tmp_path / "file"
        file.write_bytes(b"\x01" + content)
        with open(file, "r+b") as stream, pytest.raises(ValueError, match="is not the shared state of a run"):
            SharedState(fd=stream.fileno())


def test_pages_leave_no_file_open():
    before = open_files()
    for _ in range(50):
        shared = SharedState(4096)
        SharedState(fd=shared.fd)
    del shared
    assert not open_files() - before


@pytest.mark.parametrize("distribution", ["uniform", "lognormal", "small", "constant", "two"])
def test_percentiles_are_within_three_percent_and_never_too_low(distribution):
    generator = np.random.default_rng(7)
    durations = {
        "uniform": generator.integers(0, 5_000_000, 20_001),
        "lognormal": generator.lognormal(10.0, 2.0, 20_001).astype(int),
        "small": generator.integers(0, 40, 5_000),
        "constant": np.full(100, 123_456),
        "two": np.array([1_000, 1_000_000]),
    }[distribution].tolist()
    found = percentiles(durations)
    assert found["count"] == len(durations) and found["max"] == pytest.approx(max(durations) * 1e-9, rel=1e-15)
    assert durations[found["max_at_tick"]] == max(durations)
    for name, share in (("p50", 50), ("p99", 99), ("p99.9", 99.9)):
        true = np.percentile(durations, share, method="inverted_cdf")
        assert true <= found[name] * 1e9 * (1 + 1e-12) and found[name] * 1e9 <= true * (1 + 1 / 32) + 1, name


def test_a_negative_duration_counts_as_none_and_no_durations_have_no_percentiles():
    assert percentiles([-5, -7])["p50"] <= 1e-9
    assert percentiles([]) == {"count": 0, "total": 0.0, "max": 0.0, "max_at_tick": 0}


def test_random_payloads_round_trip():
    source = random.Random(3)
    shared = SharedState(1 << 13)
    for _ in range(500):
        record = source.randbytes(8 * source.randrange(1, 60))
        shared.push(RECORD_FRAME, record)
        assert shared.drain() == [(RECORD_FRAME, record)]
