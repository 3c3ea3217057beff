"""Memory that other processes share: whatever one of them writes there, no process reads or writes outside of it."""

import mmap
import os
import struct
import subprocess
import sys

import pytest

from cext.memory.shared_state import RECORD_EVENT, RECORD_ROW, SharedState
from cext.recording.newest_row import NewestRow
from cext.recording.ring_batch import read
from cext.recording.ring_reader import take
from cext.ring.rings import Line, Lines
from tests.soaking import crossed

TEXT = b'{"parameters": []}'
VALUES = (0, 1, 7, 8, 4095, 4096, 12288, 1 << 31, 1 << 40, (1 << 63) - 8, (1 << 64) - 1, (1 << 64) - 4096)


class Intruder:
    """Another mapping of a page. It finds the words that it overwrites by the numbers in them."""

    def __init__(self, shared):
        self.shared, self.memory = shared, mmap.mmap(shared.fd, 0)
        self.words = {"magic": 0, "capacity": 8, **self.find()}

    def find(self):
        """Offsets of the ring's head and tail: the words that move with a record, and with its removal."""
        found = {}
        for name, change in (("head", lambda: self.shared.push(RECORD_ROW, bytes(56))), ("tail", self.shared.drain)):
            before = self.numbers()
            change()
            moved = [index for index, (old, new) in enumerate(zip(before, self.numbers())) if new - old == 64]
            [found[name]] = [8 * index for index in moved]
        return found

    def numbers(self):
        layout = len(self.memory) - 4096 - 16 * 2 - len(TEXT)
        return struct.unpack(f"<{layout // 8}Q", self.memory[: layout // 8 * 8])

    def write(self, name, value):
        self.memory[self.words[name] : self.words[name] + 8] = struct.pack("<Q", value)

    def overwrite_ring(self, word):
        """Fill the ring with a header: kind in the lower half, bytes in the upper."""
        begin = len(self.memory) - len(TEXT) - 16 * 2 - 4096
        self.memory[begin : begin + 4096] = struct.pack("<Q", word) * 512


def state_with_intruder():
    shared = SharedState(4096, live=(2, TEXT))
    return shared, Intruder(shared)


@pytest.mark.parametrize("name", ["magic", "capacity", "head", "tail"])
@pytest.mark.parametrize("value", VALUES)
def test_the_producer_writes_into_its_ring_alone(name, value):
    shared, intruder = state_with_intruder()
    intruder.write(name, value)
    for _ in range(300):
        shared.push(RECORD_EVENT, bytes(56))
        shared.live_values()
    assert shared.live == TEXT and shared.live_values() == [(0.0, 0.0)] * 2


@pytest.mark.parametrize("name", ["capacity", "head", "tail"])
@pytest.mark.parametrize("value", VALUES)
@pytest.mark.parametrize("reader", ["drain", "read", "take", "newest"])
def test_a_reader_reads_its_ring_alone_or_reports_the_damage(name, value, reader):
    shared, intruder = state_with_intruder()
    newest = NewestRow(shared, 5)
    for _ in range(20):
        shared.push(RECORD_ROW, bytes(56))
    intruder.write(name, value)
    attempt(shared, newest, reader)


SIZES = [0, 1, 7, 8, 4088, 4096, 1 << 16, (1 << 32) - 1, (1 << 32) - 8]


@pytest.mark.parametrize("reader, size, kind", crossed(["drain", "read", "take", "newest"], SIZES, range(6)))
def test_a_record_of_any_size_is_read_within_the_ring_or_reported(kind, size, reader):
    shared, intruder = state_with_intruder()
    newest = NewestRow(shared, 5)
    for _ in range(20):
        shared.push(RECORD_ROW, bytes(56))
    intruder.overwrite_ring(kind | size << 32)
    attempt(shared, newest, reader)


def attempt(shared, newest, reader):
    try:
        if reader == "drain":
            found = sum(len(payload) for _, payload in shared.drain(10_000))
        elif reader == "read":
            parts = [[part] if isinstance(part, tuple) else list(part) for part in read(shared)]
            found = sum(len(payload) for part in parts for _, payload in part)
        elif reader == "take":
            found = take(shared, 5)[0].nbytes
        else:
            found = newest.values.nbytes if newest.look() else 0
    except ValueError as error:
        assert "damaged" in str(error) or "a row has" in str(error)
    else:
        assert found <= 4096


@pytest.mark.parametrize("name", ["magic", "capacity"])
@pytest.mark.parametrize("value", VALUES)
def test_another_process_maps_no_page_with_impossible_sizes(name, value):
    shared, intruder = state_with_intruder()
    intruder.write(name, value)
    if name == "capacity" and value == 4096:
        assert SharedState(fd=shared.fd).live == TEXT
        return
    with pytest.raises(ValueError, match="not the shared state|contradict"):
        SharedState(fd=shared.fd)


def test_no_process_can_cut_the_shared_memory():
    """An access behind its end would end every process of the run."""
    for shared in (SharedState(4096), Lines(1)):
        for size in (0, 4096, 1 << 30):
            with pytest.raises(PermissionError):
                os.truncate(shared.fd, size)


def test_an_unknown_state_counts_as_a_run_so_that_the_guardian_watches_it():
    shared, intruder = state_with_intruder()
    for state in (-1, 7, 1 << 30):
        intruder.memory[16:20] = struct.pack("<i", state)
        assert shared.state == "running"


@pytest.mark.parametrize("value", VALUES)
@pytest.mark.parametrize("place", ["outward.head", "outward.tail", "inward.head", "inward.tail"])
def test_lines_pass_frames_of_at_most_64_bytes_whatever_their_numbers(place, value):
    lines = Lines(1)
    line, memory = Line(lines, 0), mmap.mmap(lines.fd, 0)
    for _ in range(3):
        line.end.send(0x123, bytes(8))
        lines.give(0, 0x123, bytes(8), 0)
    heads = [at for at in range(0, len(memory) - 128, 64) if memory[at : at + 64] == b"\3" + bytes(63)]
    offset = heads[place.startswith("inward")] + 64 * place.endswith("tail")
    memory[offset : offset + 8] = struct.pack("<Q", value)
    assert len(lines.take(0)) <= 512
    assert len(line.end.receive(64)) <= 64
    line.begin(0)
    assert line.end.receive(64) == []
    line.end.send(0x123, bytes(8))
    lines.give(0, 0x123, bytes(8), 0)


@pytest.mark.parametrize("length", [0, 8, 64, 65, 255])
def test_a_frame_with_any_length_has_at_most_64_bytes(length):
    lines = Lines(1)
    line, memory = Line(lines, 0), mmap.mmap(lines.fd, 0)
    line.end.send(0x11223344, bytes(8), extended=True)
    lines.give(0, 0x11223344, bytes(8), 0)
    at = memory.find(struct.pack("<I", 0x91223344))
    inward = memory.find(struct.pack("<I", 0x11223344))
    for place in (at, inward):
        memory[place + 4] = length
    [(_, data, _)] = lines.take(0)
    [(_, _, received, _)] = line.end.receive()
    assert len(data) == len(received) == min(length, 64)


OVERWRITE = """
import mmap, random, struct, sys
from tests.cext.ring.test_hostile_values import VALUES
memory, chance = mmap.mmap(int(sys.argv[1]), 0), random.Random(1)
ring = len(memory) - (1 << 16)
print("begun", flush=True)
while True:
    memory[8:16] = struct.pack("<Q", chance.choice(VALUES))
    for at in (chance.randrange(ring, len(memory) - 8, 8) for _ in range(100)):
        memory[at : at + 8] = struct.pack("<Q", chance.choice(VALUES))
"""

RUN = """
import subprocess, sys
from cext.memory.shared_state import SharedState
from graph import Diagram
from tests.cext.rigs import Rig
from tests.cext.ring.test_hostile_values import OVERWRITE
from tests.cext.schedule.test_stop_values import PLANT, own, robot_with
from tests.own_drives import Wired

shared = SharedState(1 << 16)
arguments = [sys.executable, "-c", OVERWRITE, str(shared.fd)]
intruder = subprocess.Popen(arguments, pass_fds=[shared.fd], stdout=subprocess.PIPE)
try:
    intruder.stdout.readline()
    for _ in range(5):
        robot = robot_with(["mit"])
        with Diagram("plant", rate=PLANT) as plant:
            wired = Wired([own("mit")], PLANT, name="drives")
        rig = Rig(robot, plant, shared=shared)
        wired.end = rig.buses["bus0"].device
        print(rig.executor.run(1000, fade=0.0).status)
        try:
            shared.drain(1 << 20)
        except ValueError as error:
            assert "damaged" in str(error)
finally:
    intruder.kill()
"""


def test_a_run_survives_a_process_that_overwrites_its_ring():
    """A ring that is overwritten and not read any more drops records; the run itself goes on."""
    done = subprocess.run([sys.executable, "-c", RUN], capture_output=True, text=True)
    assert (done.returncode, done.stdout.split()) == (0, ["ok"] * 5), done.stderr[-2000:]
