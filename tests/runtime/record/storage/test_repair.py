"""A recording that was cut off is finished later, as independent readers find it, whatever was killed meanwhile."""

import fcntl
import io
import json
import os
import random
import resource
import signal
import struct
import subprocess
import sys
import time
from functools import cache

import numpy as np
import pytest
import zstandard
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

import runtime
from cext.memory.shared_state import RECORD_EVENT, SharedState
from cext.recording.ring_batch import read as read_ring
from runtime.host.errors import BadInput
from runtime.record.recorder.part import Recording
from runtime.record.storage import mcap_file
from runtime.record.storage.mcap_file import CHUNK_HEADS, HEAD, STREAM, head_space
from runtime.record.storage.records import A_CHUNK, A_MESSAGE, MAGIC, walk
from runtime.record.storage.repair import Backlog, Repair, RepairFailed
from runtime.record.storage.zstd_stream import BLOCK_LIMIT, decode, raw_blocks
from tests.runtime.record.recorder.running import CSV, columns, frame, plan, row, sink
from tests.runtime.record.recorder.test_mcap import chunks, unfinished
from tests.runtime.runs import environment
from tests.soaking import soaked

LEAST = 50  # bytes: magic and header


def write(folder, monkeypatch, compression, rows, flush_rows, chunk, width=40):
    """Write a recording in this process, flushed every `flush_rows` rows. Returns its bytes. chunk : bytes"""
    monkeypatch.setattr(mcap_file, "CHUNK", chunk)
    signals = columns(*(f"a.x{index} m" for index in range(width)))
    shared = SharedState(1 << 20)
    description = plan(folder, sink(CSV, "a", signals), stem="long", compression=compression, buses=["legs"])
    recording = Recording(description, shared)
    recording.open()
    recording.begin()
    for tick in range(rows):
        shared.push(4, (1000 * tick).to_bytes(8, "little"))
        shared.push(*frame(1000 * tick, 1, bytes([tick % 256])))
        shared.push(*row(tick, *[tick / 3.0] * width))
        if tick % flush_rows == flush_rows - 1:
            recording.take(read_ring(shared))
            recording.flush()
    shared.push(RECORD_EVENT, json.dumps({"event": "end", "status": "ok", "tick": 0}).encode())
    recording.take(read_ring(shared))
    recording.finish(False)
    return (folder / "long.mcap").read_bytes()


@pytest.fixture(scope="module")
def monkeypatch_module():
    with pytest.MonkeyPatch.context() as monkeypatch:
        yield monkeypatch


@pytest.fixture(scope="module", params=soaked(["none", "zstd"], but=[1]))
def short(tmp_path_factory, monkeypatch_module, request):
    """A finished recording of one chunk with frames, rows and events."""
    return write(tmp_path_factory.mktemp("short"), monkeypatch_module, request.param, 30, 6, 1 << 20, 5)


@pytest.fixture(scope="module", params=soaked(["none", "zstd"], but=[1]))
def long(tmp_path_factory, monkeypatch_module, request):
    """One of four chunks."""
    data = write(tmp_path_factory.mktemp("long"), monkeypatch_module, request.param, 1500, 50, 256 << 10)
    assert len(chunks(data)) == 4 and all(
        index.compression == request.param.replace("none", "") for index in chunks(data)
    )
    return data


def mended(path, data):
    path.write_bytes(data)
    Repair(str(path)).finish()
    return path.read_bytes()


def indexed(data):
    """What the mcap package's own reader finds by the index of chunks, its checksums looked at: [(topic, message)]."""
    reader = make_reader(io.BytesIO(data), validate_crcs=True)
    summary = reader.get_summary()
    found = [(channel.topic, message) for _, channel, message in reader.iter_messages(log_time_order=False)]
    assert summary.statistics.message_count == len(found) == sum(summary.statistics.channel_message_counts.values())
    assert {attachment.name for attachment in reader.iter_attachments()} == {
        index.name for index in summary.attachment_indexes
    }
    return found


def streamed(data):
    """All messages that are whole, one behind the other."""
    found, topics = [], {}
    try:
        for item in StreamReader(io.BytesIO(data), record_size_limit=None).records:
            if isinstance(item, Channel):
                topics[item.id] = item.topic
            elif isinstance(item, Message):
                found.append((topics[item.channel_id], item))
    except (McapError, EOFError, struct.error):
        pass
    return found


def decompressed(data):
    """Return a file, which can end anywhere, with the messages of its zstd chunks as plain records."""
    if b"\4\0\0\0zstd" not in data:
        return data
    plain, at = bytearray(data[: len(MAGIC)]), len(MAGIC)
    while at + HEAD.size <= len(data):
        kind, length = HEAD.unpack_from(data, at)
        if kind in (A_CHUNK, STREAM):
            frame = zstandard.ZstdDecompressor().decompressobj()
            plain += frame.decompress(data[at + CHUNK_HEADS["zstd"].size :])
            if not frame.eof:
                break
            at = len(data) - len(frame.unused_data)
        else:
            plain += data[at : at + HEAD.size + length]
            at += HEAD.size + length
    return bytes(plain)


def read(path):
    """Everything that the reader of this project returns, or None if it fails."""
    try:
        trial = runtime.load(path)
    except BadInput as error:
        return str(error)
    return trial.tick.tolist(), trial.rows.tobytes(), trial.frames, trial.events, trial.about, trial.end, trial.diagram


def cut_and_mended(path, data, cut):
    """Cut off at a byte, both readers see the same before and after, and mending again changes nothing."""
    path.write_bytes(data[:cut])
    zstd = b"\4\0\0\0zstd" in data
    before, messages = read(path), streamed(decompressed(data[:cut]) if zstd else unfinished_of(data)[:cut])
    try:
        Repair(str(path)).finish()
    except RepairFailed as error:
        assert cut < LEAST and "it contains nothing to repair" in str(error) and path.read_bytes() == data[:cut]
        return
    after = path.read_bytes()
    assert indexed(after) == messages and read(path) == before
    assert isinstance(before, str) or runtime.load(path).complete == (before[5] is not None)  # its end had been written
    assert not Repair(str(path)).finish() and path.read_bytes() == after


@cache
def unfinished_of(data):
    """Heads of chunks hide a cut chunk's messages from others' readers."""
    return unfinished(data) if data.endswith(b"\x89MCAP0\r\n") else data


@pytest.mark.parametrize("step", [401, pytest.param(1, marks=pytest.mark.soak)])
@pytest.mark.parametrize("heads", ["room", "chunks"])
def test_a_file_truncated_at_any_byte_is_completed_with_every_whole_message(tmp_path, short, heads, step):
    data = short if heads == "chunks" else unfinished(short)
    for cut in range(len(data) % step, len(data) + 1, step):
        cut_and_mended(tmp_path / "cut.mcap", data, cut)


@pytest.mark.parametrize("heads", soaked(["room", "chunks"], but=[1]))
def test_repair_works_for_cuts_around_chunk_boundaries(tmp_path, long, heads):
    data = long if heads == "chunks" else unfinished(long)
    edges = [index.chunk_start_offset for index in chunks(long)]
    first = chunks(long)[0]
    indices = first.chunk_start_offset + first.chunk_length
    for cut in (
        indices,
        indices + 1,
        indices + 16000,
        edges[1] - 1,
        edges[1],
        *range(edges[1] + 48, edges[1] + 55),
        edges[3] + 3000,
        len(data) - 1,
    ):
        cut_and_mended(tmp_path / "cut.mcap", data, cut)


def test_a_repaired_file_with_all_messages_equals_the_complete_recording(tmp_path, short, long):
    for whole in (short, long):
        # zeros: what a power cut leaves
        for data in (unfinished(whole), unfinished(whole)[:-3], whole[:-1], whole[:-30] + bytes(30)):
            assert mended(tmp_path / "a.mcap", data) == whole


def test_a_repair_killed_between_any_two_writes_can_be_repeated(tmp_path, long):
    """Some rooms have become chunks, in any order, one of them half, and the end is there in part or as a whole."""
    path, order = tmp_path / "a.mcap", random.Random(3)
    data_end = max(
        index.offset + index.length for index in make_reader(io.BytesIO(long)).get_summary().attachment_indexes
    )
    for _ in range(20):
        data = bytearray(unfinished(long))
        for index in chunks(long):
            size = CHUNK_HEADS[index.compression].size
            done = order.choice([0, 0, 9, 30, size, size])
            data[index.chunk_start_offset : index.chunk_start_offset + done] = long[
                index.chunk_start_offset : index.chunk_start_offset + done
            ]
        assert (
            mended(path, bytes(data[: order.choice([data_end, order.randrange(data_end, len(data)), len(data)])]))
            == long
        )


def test_repair_stops_on_full_disk_and_resumes_later(tmp_path, short):
    """The file may not grow beyond some size."""
    path, data = tmp_path / "a.mcap", unfinished(short)[:-300]
    whole = mended(path, data)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    for limit in range(len(data) - 2000, len(whole), 97):
        path.write_bytes(data)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
        try:
            with pytest.raises(OSError):
                Repair(str(path)).finish()
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        assert Repair(str(path)).finish() and path.read_bytes() == whole


@pytest.mark.soak
def test_kill_9_during_a_repair_leaves_a_repairable_file(tmp_path, long):
    path, cut = tmp_path / "a.mcap", unfinished(long)[:-50_000]
    whole, order = mended(path, cut), random.Random(5)
    for _ in range(25):
        path.write_bytes(cut)
        process = subprocess.Popen(
            [
                sys.executable,
                "-c",
                "import sys\nfrom runtime.record.storage.repair import Repair\nmending = "
                "Repair(sys.argv[1])\nmending.look()\n"
                "print(flush=True)\nmending.finish()",
                path,
            ],
            env=environment(),
            stdout=subprocess.PIPE,
        )
        process.stdout.readline()
        time.sleep(order.uniform(0.0, 0.03))
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        process.stdout.close()
        Repair(str(path)).finish()
        assert path.read_bytes() == whole


def test_damaged_file_is_not_modified(tmp_path, long):
    path, sound = tmp_path / "a.mcap", unfinished(long)
    plain = not chunks(long)[0].compression
    source = sound if plain else long  # whose records can be walked through
    stream = io.BytesIO(source)
    stream.seek(len(MAGIC))
    middle = next(at for at, _, _ in walk(stream, len(MAGIC)) if at > len(sound) // 2)  # where a record begins
    for data in (sound[:middle] + b"\xff" * 30 + sound[middle + 30 :], sound[:middle] + sound[middle + 5 :]):
        path.write_bytes(data)
        with pytest.raises(
            RepairFailed, match=r"a\.mcap is damaged from byte \d+ of \d+ on: `convert` writes the undamaged parts"
        ):
            Repair(str(path)).finish()
        assert path.read_bytes() == data


def test_repair_keeps_a_wrong_checksum(tmp_path, long):
    if chunks(long)[1].compression:  # zstd content is damaged as a whole
        checksum = bytes([long[chunks(long)[1].chunk_start_offset + 33] ^ 0xA5])
        place, spoilt = chunks(long)[1].chunk_start_offset + 33, long[:-1]
        with pytest.raises(RepairFailed, match="damaged"):
            mended(tmp_path / "a.mcap", spoilt[: place + 500] + b"\xa5" + spoilt[place + 501 :])
        spoilt = spoilt[:place] + checksum + spoilt[place + 1 :]
    else:
        place = chunks(long)[1].chunk_start_offset + 200  # in the middle of a double
        spoilt = long[:place] + bytes([long[place] ^ 0xA5]) + long[place + 1 : -1]
    found = mended(tmp_path / "a.mcap", spoilt)
    assert len(found) == len(long)
    if not chunks(long)[1].compression:
        assert "are lost, with the ticks " in runtime.load(tmp_path / "a.mcap").trouble
    with pytest.raises(ValueError, match="crc validation failed"):
        indexed(found)


DAMAGE = {  # {name: (position in a message record, bytes written there)}
    "none": (0, b""),
    "kind": (0, b"\7"),
    "chunk": (0, bytes([A_CHUNK])),
    "short": (1, bytes(8)),
    "long": (1, (1 << 20).to_bytes(8, "little")),
    "channel": (9, b"\xff\xff"),
    "time": (15, bytes(8)),
}


def checked_rows(path):
    trial = runtime.load(path)
    trial.check()
    return trial.rows


@pytest.mark.parametrize("damage", DAMAGE)
def test_repair_keeps_everything_that_was_read_of_an_open_chunk(tmp_path, monkeypatch, damage):
    """A block of the chunk ends within a message, and a message in front of that is damaged."""
    data = write(tmp_path, monkeypatch, "zstd", 60, 6, 1 << 20, 400)
    begin = chunks(data)[0].chunk_start_offset
    frame = data[begin + CHUNK_HEADS["zstd"].size :]
    content, ends, _ = decode(frame, 1 << 20)
    content = bytearray(content[: BLOCK_LIMIT + 1000])
    found = [at for at, kind, _ in walk(io.BytesIO(content), 0) if kind == A_MESSAGE]
    shift, replacement = DAMAGE[damage]
    at = found[-6] + shift
    content[at : at + len(replacement)] = replacement
    path, whole = tmp_path / "cut.mcap", runtime.load(tmp_path / "long.mcap").rows
    path.write_bytes(data[:begin] + head_space("zstd") + frame[: ends[0][0]] + raw_blocks(bytes(content)))
    rows = checked_rows(path)
    assert 28 < len(rows) < 32 and (rows == whole[: len(rows)]).all()
    try:
        Repair(str(path)).finish()
    except RepairFailed:
        assert damage in ("kind", "chunk", "short", "channel")
    assert checked_rows(path).tobytes() == rows.tobytes()


def test_active_recordings_and_other_files_are_not_repaired(tmp_path, short):
    path = tmp_path / "a.mcap"
    path.write_bytes(unfinished(short)[:-9])
    with open(path, "rb") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        with pytest.raises(RepairFailed, match="a.mcap is still being recorded"):
            Repair(str(path))
    for data in (b"", b"time,tick\n1,2\n", short[:12], short[: LEAST - 20].replace(b"tickwork", b"ros2bag2")):
        path.write_bytes(data)
        with pytest.raises(RepairFailed, match="it contains nothing to repair"):
            Repair(str(path)).finish()
        assert path.read_bytes() == data


def test_backlog_is_scanned_in_slices_and_unfinished_files_reported(tmp_path, long):
    paths = [str(tmp_path / f"{number}.mcap") for number in range(4)]
    middle = len(long) // 2
    contents = unfinished(long)[:-9], b"", unfinished(long)[:middle] + unfinished(long)[middle + 1 :], long
    for path, content in zip(paths, contents):
        with open(path, "wb") as file:
            file.write(content)
    backlog = Backlog([*paths, str(tmp_path / "gone.mcap")])
    slices = 0
    while backlog.look():
        slices += 1
    # so far it has only looked
    assert (4 if chunks(long)[0].compression else 10) < slices < 30 and [
        open(path, "rb").read() for path in paths
    ] == list(contents)
    problems = backlog.finish()
    assert [open(path, "rb").read() for path in paths] == [long, b"", contents[2], long]
    assert (
        len(problems) == 2
        and "gone.mcap was not completed: No such file" in problems[0]
        and "2.mcap is damaged from byte" in problems[1]
    )


def test_truncated_recording_stays_marked_after_repair(tmp_path, short):
    path = tmp_path / "a.mcap"
    mended(path, unfinished(short)[: len(short) // 2])
    trial = runtime.load(path)
    told = f"{path} was completed later: its recorder was killed, or it was truncated; {len(trial)} of its ticks are "
    assert not trial.complete and trial.trouble == told + "not verified by a checksum" and not trial.unfinished
    assert 2 < len(trial) < 30 and np.array_equal(trial.tick, np.arange(len(trial)))
