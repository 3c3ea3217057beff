"""A damaged byte costs the chunk that it is in, and nothing else: every view of the recording agrees and is true."""

import io
import json
import pickle
import random
from itertools import cycle, islice

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

import runtime
from cext.memory.shared_state import RECORD_EVENT, SharedState
from cext.recording.ring_batch import read as read_ring
from runtime.host.console.progress import Progress
from runtime.host.errors import CHECK_FAILED, OK, BadInput
from runtime.record.analysis.picture import broken
from runtime.record.recorder.part import Recording
from runtime.record.storage import mcap_file, read_ahead
from runtime.record.storage.mcap_file import HEAD
from runtime.record.storage.messages import ROW_END
from runtime.record.storage.records import LIBRARY
from tests.runtime.record.recorder.running import CSV, columns, frame, plan, row, sink
from tests.soaking import soaked

TICKS, EVERY, RATE = 36, 3, 200
PATHS = ["left/knee.position rad", "left/knee.torque N·m", "right/imu.gyro rad/s", "right/slow.temperature °C"]
SLOW = 3  # place of the signal that is recorded at every EVERY-th tick


def written(folder, monkeypatch, compression, finished=True):
    """A recording of small chunks with frames of two buses, marks, and a signal at a lower rate. Returns its bytes.

    finished : whether they are those at the end; else those at the last flush, which kill -9 leaves
    """
    monkeypatch.setattr(mcap_file, "CHUNK", 1500)
    signals = columns(*PATHS)
    signals[SLOW]["every"] = EVERY
    shared = SharedState(1 << 20)
    order = plan(folder, sink(CSV, "a", signals), compression=compression, buses=["legs", "arms"])
    recording = Recording(order, shared)
    recording.open()
    recording.begin()
    dice = random.Random(1)
    for tick in range(TICKS):
        shared.push(4, (5_000_000 * tick).to_bytes(8, "little"))
        shared.push(*frame(5_000_000 * tick, 1, dice.randbytes(8)))
        shared.push(*frame(5_000_000 * tick + 1, 2, bytes([tick]), sent=1, bus=1))
        shared.push(*row(tick, *(dice.uniform(-9.0, 9.0) for _ in PATHS)))
        if tick % 7 == 0:
            shared.push(RECORD_EVENT, json.dumps({"event": "mark", "number": tick, "tick": tick}).encode())
        recording.take(read_ring(shared))
        recording.flush()
    shared.push(RECORD_EVENT, json.dumps({"event": "end", "status": "ok", "tick": TICKS}).encode())
    recording.take(read_ring(shared))
    recording.flush()
    unfinished = (folder / "bench_1.mcap").read_bytes()
    recording.finish(False)
    return unfinished if not finished else (folder / "bench_1.mcap").read_bytes()


def in_small_chunks(data, compression):
    """The recording in chunks of another writer, which end anywhere in a row."""
    out, channels, topics = io.BytesIO(), {}, {}
    writer = Writer(out, chunk_size=900, compression=compression)
    writer.start(library=LIBRARY)
    for record in StreamReader(io.BytesIO(data)).records:
        if isinstance(record, Attachment):
            writer.add_attachment(0, 0, record.name, record.media_type, record.data)
        elif isinstance(record, Channel) and record.id not in topics:
            topics[record.id] = record.topic
            schema = writer.register_schema(record.topic, "protobuf", b"")
            channels[record.id] = writer.register_channel(record.topic, "protobuf", schema)
        elif isinstance(record, Message):
            writer.add_message(
                channels[record.channel_id], record.log_time, record.data, record.publish_time, record.sequence
            )
    writer.finish()
    return out.getvalue()


def chunks(data):
    return make_reader(io.BytesIO(data)).get_summary().chunk_indexes


def chunks_of_ticks(data):
    """[(begin, end, ticks that have a message in it)] of the chunks of a file."""
    found = []
    for index in chunks(data):
        end = index.chunk_start_offset + index.chunk_length + index.message_index_length
        inside = make_reader(io.BytesIO(data)).iter_messages(log_time_order=False)
        ticks = {
            message.sequence
            for _, channel, message in inside
            if index.message_start_time <= message.log_time <= index.message_end_time
            and (channel.topic == ROW_END or not channel.topic.startswith("/tickwork"))
        }
        found.append((index.chunk_start_offset, end, ticks))
    return found


FILES = {
    "zstd": lambda folder, patch: written(folder, patch, "zstd"),
    "none": lambda folder, patch: written(folder, patch, "none"),
    "zstd-unfinished": lambda folder, patch: written(folder, patch, "zstd", finished=False),
    "none-unfinished": lambda folder, patch: written(folder, patch, "none", finished=False),
    "zstd-of-another": lambda folder, patch: in_small_chunks(written(folder, patch, "none"), CompressionType.ZSTD),
    "lz4-of-another": lambda folder, patch: in_small_chunks(written(folder, patch, "none"), CompressionType.LZ4),
    "none-of-another": lambda folder, patch: in_small_chunks(written(folder, patch, "none"), CompressionType.NONE),
}
DAMAGES = {
    "flip": lambda data, at: data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :],
    "bit": lambda data, at: data[:at] + bytes([data[at] ^ 1 << at % 8]) + data[at + 1 :],
    "zero": lambda data, at: data[:at] + b"\0" + data[at + 1 :],
    "sector": lambda data, at: data[:at] + bytes(64) + data[at + 64 :],
    "removed": lambda data, at: data[:at] + data[at + 1 :],
    "cut": lambda data, at: data[:at],
    "padded": lambda data, at: data[:at] + bytes(len(data) - at),
    "padded far": lambda data, at: data[:at] + bytes(20_000),
}
TO_THE_END = ("cut", "padded", "padded far")
SHORTER = (*TO_THE_END, "removed")


class File:
    """A recording whose chunks and content are known. open : first byte of the chunk without a head; None without"""

    def __init__(self, data, path):
        self.data, self.path = data, path
        path.write_bytes(data)
        trial = runtime.load(path)
        self.rows = dict(zip(trial.tick.tolist(), map(np.ndarray.tobytes, trial.rows)))
        self.frames = {frame.time: (frame.bus, frame.sent, frame.payload) for frame in trial.frames}
        self.events = trial.events
        self.open = None
        contents = trial.file.readers[0].contents
        # a wrong byte is corrected in an attachment, and may have no effect in compressed messages
        self.tolerant = [(begin + HEAD.size, begin + size) for begin, size in contents.attachments]
        self.tolerant += [(chunk.begin, chunk.begin + chunk.length) for chunk in contents.chunks if chunk.compression]

    def must_be_reported(self, at):
        """Whether a wrong byte at a position is reported, although no tick is lost: everywhere in a finished file."""
        return self.open is None and not any(begin <= at < end for begin, end in self.tolerant)

    def lost(self, begin, end):
        """Ticks with a message in a chunk that has one of the bytes from `begin` to `end`, or on both sides of them."""
        inside = [ticks for low, high, ticks in self.chunks if low < end and begin < high]
        pairs = zip(self.chunks, self.chunks[1:])
        around = [ticks & others for (_, low, ticks), (high, _, others) in pairs if low < end and begin < high]
        return set().union(*inside, *around)


@pytest.fixture(autouse=True)
def one_thread(monkeypatch):
    """To start threads for files of a few kilobytes takes longer than to read them."""
    monkeypatch.setattr(read_ahead, "THREADS_LIMIT", 1)


@pytest.fixture(scope="module", params=soaked(list(FILES), but=[0, 3]))
def file(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("damage")
    with pytest.MonkeyPatch.context() as patch:
        data = FILES[request.param](folder, patch)
        made = File(data, folder / "damaged.mcap")
        if "unfinished" in request.param:
            whole = (folder / "bench_1.mcap").read_bytes()
            made.chunks = chunks_of_ticks(whole)
            made.open = made.chunks[-1][0]
        else:
            made.chunks = chunks_of_ticks(data)
    assert len(made.chunks) > 5 and len(made.rows) > TICKS - 10
    return made


def seen(trial):
    """Ticks and values of a trial as each of its views returns them."""
    names = list(trial.signals)
    yield "tick", trial.tick, trial.rows
    yield "signals", trial.tick, np.column_stack([trial.column(name) for name in names])
    batches = [batch.rows for batch in trial.batches()]
    yield "batches", np.concatenate(batches)[:, 0].astype(int), np.concatenate(batches)[:, 2:]
    groups = [*trial.row_groups(7)]
    yield (
        "groups",
        *(
            np.concatenate([np.empty(shape), *parts])
            for shape, parts in (
                (0, [group.tick for group in groups]),
                ((0, len(names)), [group.values for group in groups]),
            )
        ),
    )
    part = trial.between(-1.0, 1e9)
    yield "between", part.tick, part.rows


def check(file, damaged, begin, end, kind, thorough=True):
    """Every view agrees, is true, and has all but the chunks with the bytes from `begin` to `end`."""
    file.path.write_bytes(damaged)
    try:
        trial = runtime.load(file.path)
        count = len(trial)
    except BadInput:
        first = file.chunks[0][0]
        assert begin < first or file.open is None and kind in TO_THE_END, (begin, kind)
        return None
    trouble = trial.trouble
    if thorough:
        first, other = runtime.load(file.path), runtime.load(file.path)
        assert first.trouble == trouble and len(first) == count
        assert len(other.frames) == len(trial.frames) and len(other.tick) == count
        assert pickle.loads(pickle.dumps(trial)).rows.tobytes() == trial.rows.tobytes()
        for name, ticks, rows in seen(trial):
            assert len(ticks) == count and np.array_equal(ticks, trial.tick), (begin, kind, name)
            assert rows.tobytes() == np.ascontiguousarray(trial.rows).tobytes(), (begin, kind, name)
    changed = file.lost(begin, end)
    if damaged != file.data and file.must_be_reported(begin):
        assert trouble and not trial.complete, (begin, kind)
    assert not trial.unverified or kind in SHORTER and trouble and not trial.unfinished, (begin, kind, trouble)
    unverified = set(trial.tick[max(0, count - trial.unverified) :].tolist()) & changed
    for tick, values in zip(trial.tick.tolist(), trial.rows):
        assert tick in unverified or file.rows.get(tick) == values.tobytes(), (begin, kind, tick)
    missing = file.rows.keys() - set(trial.tick.tolist())
    assert missing <= changed, (begin, kind, sorted(missing - changed), trouble)
    if missing:
        assert trouble and not trial.complete and not trial.unfinished, (begin, kind, trouble)
    if not unverified:
        assert all(file.frames.get(frame.time) == (frame.bus, frame.sent, frame.payload) for frame in trial.frames)
        assert all(event in file.events for event in trial.events)
    return missing


def damages(file, places, kinds):
    for at, kind in zip(places, kinds):
        until = len(file.data) if kind in TO_THE_END else at + (64 if kind == "sector" else 1)
        yield DAMAGES[kind](file.data, at), at, until, kind


def test_a_damaged_byte_costs_its_chunk_and_every_view_agrees(file):
    dice, (begin, end, _) = random.Random(7), file.chunks[3]
    places = [begin - 9, begin, begin + 1, begin + 41, end - 9, end, (begin + end) // 2, *file.chunks[0][:1]]
    places += dice.sample(range(len(file.data)), 8)
    made = damages(file, [*places, (begin + end) // 2], [*DAMAGES, *DAMAGES, "flip"])
    first = len(file.data) % 3  # every third is looked at with every view, others of each file
    costs = [check(file, *damage, thorough=number % 3 == first) for number, damage in enumerate(made)]
    assert any(costs)


def test_a_wrong_byte_of_the_metadata_is_corrected_by_their_checksum(file):
    about = file.data.index(b'{"')
    for at in (about + 1, file.data.index(b"knee") + 1, file.data.index(b'"rate": 200') + 9):
        assert check(file, DAMAGES["bit"](file.data, at), at, at + 1, "bit") == set()
        trial = runtime.load(file.path)
        assert trial.about["rate"] == RATE and list(trial.signals) == [path.split()[0] for path in PATHS]


def test_a_wrong_byte_outside_of_every_chunk_is_reported_although_no_tick_is_lost(file):
    """Of the magic bytes, the header, a schema, a channel, the end of the data, the summary and the footer."""
    last, size = file.chunks[-1][1], len(file.data)
    places = [*range(file.chunks[0][0])]
    if file.open is None:
        places += [*range(last, last + 13), *range(size - 37, size)]
    else:
        places = places[:33]
    for damage in damages(file, random.Random(5).sample(places, 12), cycle(["bit", "flip"])):
        assert check(file, *damage, thorough=False) in (set(), None)
        trial = runtime.load(file.path)
        assert not trial.complete and not trial.unfinished or file.open is None and not file.must_be_reported(damage[1])


def test_a_wrong_size_of_a_chunk_costs_that_chunk_alone(file):
    at = file.chunks[2][0] + 25  # after the head of the record and two times
    first = len(file.data) % 3
    for number, damage in enumerate(damages(file, range(at, at + 8), cycle(["flip", "bit"]))):
        check(file, *damage, thorough=number % 3 == first)


def test_an_end_of_zeros_is_reported_from_any_byte_of_the_footer_on(file):
    if file.open is None:
        for at in range(len(file.data) - 37, len(file.data)):
            file.path.write_bytes(DAMAGES["padded"](file.data, at))
            assert not runtime.load(file.path).complete, at


def test_a_summary_without_a_checksum_is_accepted_of_another_writer_alone(tmp_path, monkeypatch):
    for library, complete in ((LIBRARY, False), ("mcap go v1.7.0", True)):
        monkeypatch.setitem(globals(), "LIBRARY", library)
        data = FILES["zstd-of-another"](tmp_path, monkeypatch)
        (tmp_path / "a.mcap").write_bytes(data[:-12] + bytes(4) + data[-8:])
        trial = runtime.load(tmp_path / "a.mcap")
        assert trial.complete == complete and bool(trial.trouble) != complete and len(trial) == TICKS


@pytest.mark.soak
def test_each_byte_of_a_recording_costs_no_more_than_its_chunk(file):
    for first in range(len(DAMAGES)):
        for number, damage in enumerate(damages(file, range(len(file.data)), islice(cycle(DAMAGES), first, None))):
            check(file, *damage, thorough=number % 100 == 0)


def test_a_gap_is_visible_in_every_use_of_the_recording(tmp_path, monkeypatch, command_line):
    monkeypatch.chdir(command_line.folder)
    data = written(command_line.folder, monkeypatch, "zstd")
    begin, end, ticks = chunks_of_ticks(data)[2]
    path = command_line.folder / "bench_1.mcap"
    path.write_bytes(DAMAGES["flip"](data, (begin + end) // 2))
    first, last = min(ticks), max(ticks)
    lost = f"of its {len(data)} bytes, {begin} to {end - 1} are lost, with the ticks {first} to {last} "
    for words in (["convert", path, "--to", "csv,mcap,sto"], ["plot", path], ["diff", path, path]):
        code, _, err = command_line(*words)
        assert lost in err and code == (CHECK_FAILED if words[0] == "convert" else OK)
    for copy in ("bench_1-2.mcap", "bench_1.mcap"):
        assert not set(ticks) & set(runtime.load(command_line.folder / copy).tick.tolist())
    assert "cannot be replayed: the inputs of these ticks are missing" in command_line.refused("replay", path)
    trial = runtime.load(path)
    assert trial.damaged and trial.gaps == [((first - 1) / RATE, (last + 1) / RATE)]
    at = np.isin(np.arange(TICKS), sorted(ticks))
    again = trial.resample(RATE)
    assert np.array_equal(np.isnan(again["left/knee.position"]), at[: len(again)])
    assert not np.isnan(again["left/knee.position"][~at[: len(again)]]).any()
    times, values = broken(trial.tick, trial.time, trial["left/knee.position"])
    assert len(values) == len(trial) + 1 and np.isnan(values[first]) and not np.isnan(np.delete(values, first)).any()


def test_control_characters_in_names_are_shown_escaped(tmp_path, monkeypatch):
    path = tmp_path / "a\x1b[31mb.mcap"
    path.write_bytes(written(tmp_path, monkeypatch, "zstd"))
    trial = runtime.load(path)
    trial.about["metadata"]["trial"] = {"subject": "S\x1b]0;title\x07"}
    assert "\x1b" not in repr(trial) and "a\\x1b[31mb.mcap" in repr(trial) and "S\\x1b]0;title\\x07" in repr(trial)
    assert "\x1b" not in Progress(f"reading {path.name}").what
