"""The flight log, as independent readers find it: the mcap package, and protobuf's own decoder."""

import io
import json
import math
import struct

import numpy as np
import pytest
import zstandard
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader

import runtime
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from cext.memory.shared_state import RECORD_FRAME, RECORD_RECEIVED, SharedState
from graph import Block, Diagram, Input, Output, subsystem
from runtime.record.storage.mcap_file import CHUNK, HEAD, INDEX, MESSAGE, head_space
from tests.runtime.record.recorder.running import (
    CSV,
    columns,
    counting,
    frame,
    leg,
    plan,
    read_csv,
    record,
    row,
    run,
    sink,
)

LEGS = "/tickwork/can/legs"
EXTENDED, REMOTE = 0x80000000, 0x40000000


class Log:
    """channels : {topic: [(log time in ns, decoded message)]}, attachments : {name: decoded JSON}, order : topics as
    they come
    """

    def __init__(self, data):
        self.channels, self.attachments, self.order = {}, {}, []
        schemas, channels = {}, {}
        try:
            for item in StreamReader(io.BytesIO(data), record_size_limit=None).records:
                if isinstance(item, Schema):
                    schemas[item.id] = decoder(item)
                elif isinstance(item, Channel):
                    channels[item.id] = item
                    self.channels.setdefault(item.topic, [])
                elif isinstance(item, Attachment):
                    self.attachments[item.name] = json.loads(item.data)
                elif isinstance(item, Message):
                    channel = channels[item.channel_id]
                    self.channels[channel.topic].append((item.log_time, schemas[channel.schema_id](item.data)))
                    self.order.append(channel.topic)
        except (McapError, EOFError, struct.error):
            self.cut = True
        else:
            self.cut = False

    def signal(self, path):
        """ "/left knee position" over the ticks."""
        topic, *names = path.split()
        found = []
        for _, message in self.channels[topic]:
            for name in names:
                message = getattr(message, name)
            found.append(message if isinstance(message, (int, float)) else list(message))
        return found


def decoder(schema):
    files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name)).FromString


def log(path):
    found = Log(path.read_bytes())
    assert not found.cut
    return found


def test_every_signal_of_every_tick_is_recorded_under_its_path(tmp_path):
    class Rates(Block):
        """A vector, and a name that protobuf would not take."""

        rate = Output("rad/s", shape=(3,))
        öffnung = Output("1")

        def step(self, t):
            return [t, 2.0 * t, math.nan], 0.5

    with Diagram("robot", rate=200) as diagram:
        Sine(frequency=1.0, name="wave")
        with subsystem("left"), subsystem("foot"):
            Rates(name="imu")
        CsvRecorder()
    run(diagram, tmp_path, 100)
    found = log(tmp_path / "robot.mcap")
    header, rows = read_csv(tmp_path / "robot.csv")
    assert found.signal("/robot wave y") == [float(cells[header.index("wave.y")]) for cells in rows]
    rates = found.signal("/left/foot imu rate")
    assert [rate[:2] for rate in rates] == [[k / 200, 2 * k / 200] for k in range(100)] and all(
        math.isnan(rate[2]) for rate in rates
    )
    assert found.signal("/left/foot imu x_ffnung") == [0.5] * 100
    assert found.signal("/tickwork/tick tick") == list(range(100)) and found.signal("/tickwork/tick time") == [
        k / 200 for k in range(100)
    ]
    assert [time for time, _ in found.channels["/tickwork/tick"]] == [5_000_000 * k for k in range(100)]
    assert [signal["path"] for signal in found.attachments["about.json"]["signals"]] == [
        "left/foot/imu.rate[0]",
        "left/foot/imu.rate[1]",
        "left/foot/imu.rate[2]",
        "left/foot/imu.öffnung",
        "wave.y",
    ]
    # the row is whole when /tickwork/tick has come
    assert found.order[:3] == ["/left/foot", "/robot", "/tickwork/tick"]


def test_equal_converted_names_are_made_unique(tmp_path):
    record(
        plan(tmp_path, sink(CSV, "a", columns("é.x 1", "è.x 1", "a.b.x 1", "plain 1"))), [row(0, 1.0, 2.0, 3.0, 4.0)]
    )
    [(_, message)] = log(tmp_path / "bench_1.mcap").channels["/bench"]
    assert sorted(field.name for field in message.DESCRIPTOR.fields) == ["a_b", "signals", "x_", "x__2"]
    assert {message.x_.x, message.x__2.x} == {1.0, 2.0} and message.a_b.x == 3.0 and message.signals.plain == 4.0


def test_messages_and_their_fields_have_unique_names(tmp_path):
    """Viewers identify a message by its name; the strict readers among them take no field that is called as a message
    beside it.
    """
    paths = (
        "a/b/c.x",
        "a_b/c.x",
        "Tick/c.x",
        "Event/c.x",
        "leg/u.x",
        "leg/u_t.x",
        "leg/u_t_t.x",
        "tickwork/c.x",
        "tickwork_/c.x",
    )
    record(
        plan(tmp_path, sink(CSV, "a", columns(*(f"{path} m" for path in paths))), buses=["bus"]),
        [row(0, *range(len(paths)))],
    )
    data = (tmp_path / "bench_1.mcap").read_bytes()
    schemas = [
        item for item in StreamReader(io.BytesIO(data), record_size_limit=None).records if isinstance(item, Schema)
    ]
    names = {schema.id: schema.name for schema in schemas}
    assert len(set(names.values())) == len(names) == 10 and "tickwork.Tick" in names.values()
    for schema in schemas:
        [file] = descriptor_pb2.FileDescriptorSet.FromString(schema.data).file
        [message] = file.message_type
        inside = [field.name for field in message.field] + [nested.name for nested in message.nested_type]
        assert len(set(inside)) == len(inside), schema.name
    trial = runtime.load(tmp_path / "bench_1.mcap")
    assert [trial[path].tolist() for path in paths] == [[float(number)] for number in range(len(paths))]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(values=st.lists(st.floats(), min_size=1, max_size=40))
def test_every_double_is_kept_to_the_bit(tmp_path_factory, values):
    folder = tmp_path_factory.mktemp("bits")
    record(
        plan(folder, sink(CSV, "a", columns(*(f"left/b{i // 5}.x{i} m" for i in range(len(values)))))),
        [row(3, *values, lateness=1.25e-5)],
    )
    found = log(folder / "bench_1.mcap")
    got = [found.signal(f"/left b{i // 5} x{i}")[0] for i in range(len(values))]
    assert [repr(value) for value in got] == [repr(value) for value in values]
    assert found.signal("/tickwork/tick lateness") == [1.25e-5] and found.signal("/tickwork/tick tick") == [3]


def test_frames_keep_order_bus_direction_kind_and_nanoseconds(tmp_path):
    frames = [
        frame(1, 0x123, b"\1\2"),
        frame(1_000_000_007, 0x801 | EXTENDED, b"", sent=1),
        frame(1_000_000_007, 5, bytes(range(64)), flags=5, bus=1),
        frame(2_000_000_000, 0x7 | REMOTE, b""),
    ]
    record(plan(tmp_path, buses=["legs", "arms"]), frames)
    found = log(tmp_path / "bench_1.mcap")
    [(time, legs)], [(_, arms)] = found.channels["/tickwork/can/legs"], found.channels["/tickwork/can/arms"]
    first, second, third = legs.frames
    assert time == 1 and legs.drained == 0 and (first.time, first.id, first.data, first.order) == (1, 0x123, b"\1\2", 0)
    assert not any((first.sent, first.extended, first.fd, first.remote, first.error))
    assert (second.time, second.id, second.data, second.order) == (1_000_000_007, 0x801, b"", 1)
    assert second.sent and second.extended and not second.remote
    assert third.remote and third.id == 7 and third.order == 3
    [long] = arms.frames
    assert (long.time, long.id, long.data, long.order) == (1_000_000_007, 5, bytes(range(64)), 2)
    assert long.fd and long.rate_switch and not long.error_state
    assert found.order == ["/tickwork/can/legs", "/tickwork/can/arms", "/tickwork/events"]
    read = runtime.load(tmp_path / "bench_1.mcap").frames
    assert [frame.payload for frame in read] == [payload for _, payload in frames]


def test_frames_are_grouped_by_drain_and_keep_their_order_with_rows(tmp_path):
    def drain(time):
        return RECORD_RECEIVED, time.to_bytes(8, "little", signed=True)

    records = [
        frame(3, 9, b"early", sent=1),
        drain(1000),
        frame(990, 1, b"a"),
        frame(995, 2, b"b", bus=1),
        frame(1010, 3, b"c", sent=1),
        row(0, 1.0),
        frame(1020, 4, b"after", sent=1),
        drain(2000),
        drain(3000),
        frame(2990, 1, b"d"),
        row(1, 2.0),
    ]
    record(plan(tmp_path, sink(CSV, "a", columns("a.x m")), buses=["legs", "arms"]), records)
    found = log(tmp_path / "bench_1.mcap")
    legs = [(time, message.drained, [item.id for item in message.frames]) for time, message in found.channels[LEGS]]
    assert legs == [(3, 0, [9]), (1000, 1000, [1, 3]), (1000, 1000, [4]), (3000, 3000, [1])]
    trial = runtime.load(tmp_path / "bench_1.mcap")
    payloads = [payload for kind, payload in records if kind == RECORD_FRAME]
    assert [item.payload for item in trial.frames] == payloads
    assert [(item.drain, item.drained, item.row) for item in trial.frames] == [
        (0, 0, 0),
        (1, 1000, 0),
        (1, 1000, 0),
        (1, 1000, 0),
        (1, 1000, 1),
        (3, 3000, 1),
    ]


def test_in_real_time_the_log_shows_the_wall_clock_and_how_late_each_tick_was(tmp_path):
    outcome, report, shared = run(counting(rate=500), tmp_path, 50, virtual=False)
    found = log(tmp_path / "counting.mcap")
    ticks, times = found.signal("/tickwork/tick tick"), [time for time, _ in found.channels["/tickwork/tick"]]
    assert [time - shared.wall for time in times] == [2_000_000 * tick for tick in ticks]
    late = found.signal("/tickwork/tick lateness")
    # the grid point that was awaited
    behind = [now + (tick - before - 1) / 500 for now, tick, before in zip(late, ticks, [-1, *ticks])]
    assert max(behind) == pytest.approx(shared.statistics()["lateness"]["max"], abs=1e-9) and min(late) > 0.0
    assert found.attachments["end.json"]["statistics"]["ticks"] == len(ticks)


def test_end_and_start_metadata_are_attached(tmp_path):
    diagram, plant = leg()
    run(diagram, tmp_path, 10, plant=plant, metadata={"trial": {"subject": "S03"}}, diagram_json='{"hash": "sha256:1"}')
    found = log(tmp_path / "leg.mcap")
    about, end = found.attachments["about.json"], found.attachments["end.json"]
    assert found.attachments["diagram.json"] == {"hash": "sha256:1"} and about["hash"] == "sha256:1"
    assert (
        about["metadata"] == {"trial": {"subject": "S03"}}
        and about["versions"]["python"]
        and about["machine"]["processors"] > 0
    )
    assert (end["ended"], end["ticks"], end["last_tick"]) == ("ok", 10, 9)
    assert json.loads((tmp_path / "leg.json").read_text())["machine"] == about["machine"]


def unfinished(data):
    """Return the file as it was before the heads of its chunks were written."""
    data = bytearray(data)
    for index in chunks(bytes(data)):
        checksum = int.from_bytes(data[index.chunk_start_offset + 33 :][:4], "little")
        stamp = (index.uncompressed_size, checksum)
        room = head_space(index.compression, stamp, stamp, index.compressed_size)
        data[index.chunk_start_offset : index.chunk_start_offset + len(room)] = room
    return bytes(data)


def full_chunks(data):
    """Yield (position, messages as bytes) of every chunk, as the mcap package decompresses it."""
    for index in chunks(data):
        at = index.chunk_start_offset + HEAD.size
        chunk = Chunk.read(ReadDataStream(io.BytesIO(data[at : at + index.chunk_length - HEAD.size])))
        yield index.chunk_start_offset, zstandard.decompress(chunk.data, chunk.uncompressed_size)


def chunks(data):
    return make_reader(io.BytesIO(data)).get_summary().chunk_indexes


@pytest.mark.soak
def test_uncompressed_and_cut_off_at_any_byte_it_opens_up_to_the_last_complete_row(tmp_path):
    diagram, plant = leg()
    run(diagram, tmp_path, 30, plant=plant, compression="none")
    finished = (tmp_path / "leg.mcap").read_bytes()
    data = unfinished(finished)
    whole = Log(data)
    positions, at = whole.signal("/left knee position"), 0
    assert len(positions) == 30 and not whole.cut and Log(finished).order == whole.order
    for cut in range(0, len(data), 13):
        found = Log(data[:cut])
        ticks = found.signal("/tickwork/tick tick") if "/tickwork/tick" in found.channels else []
        assert ticks == list(range(len(ticks))) and len(ticks) >= at
        assert found.signal("/left knee position")[: len(ticks)] == positions[: len(ticks)] if ticks else True
        at = len(ticks)
    assert at == 30


def test_a_truncated_file_is_read_up_to_the_cut_and_a_damaged_one_without_its_chunk(tmp_path):
    record(
        plan(tmp_path, sink(CSV, "a", columns(*(f"a.x{index} m" for index in range(40)))), stem="long"),
        [row(k, *[float(k)] * 40) for k in range(6000)],
        SharedState(1 << 22),
    )
    data = (tmp_path / "long.mcap").read_bytes()
    first, second, *_ = chunks(data)
    assert CHUNK <= first.uncompressed_size < CHUNK + 1000
    whole = runtime.load(tmp_path / "long.mcap")
    assert whole.complete and len(whole) == 6000
    file = tmp_path / "cut.mcap"
    start, length = second.chunk_start_offset, second.chunk_length
    ticks = []
    for cut in (start - 5, start + 40, start + length // 2, start + length - 1):
        file.write_bytes(data[:cut])
        found = runtime.load(file)
        ticks.append(len(found))
        assert not found.complete and np.array_equal(found.rows, whole.rows[: len(found)])
    assert ticks[0] == ticks[1] < ticks[2] < ticks[3] and ticks[0] > 2000
    for spoilt in (start + length // 2, start + 12):  # the stream; a time, which is compared with the index of chunks
        file.write_bytes(data[:spoilt] + bytes([data[spoilt] ^ 0xA5]) + data[spoilt + 1 :])
        found = runtime.load(file)
        kept = np.isin(whole.tick, found.tick)
        assert kept[: ticks[0]].all() and kept[ticks[3] + 10 :].all() and not found.complete and found.trouble
        assert len(found) == kept.sum() and np.array_equal(found.rows, whole.rows[kept])


def test_readers_find_messages_by_the_index_of_chunks(tmp_path):
    """As Foxglove and Rerun do, which see nothing of a file without."""
    diagram, plant = leg()
    run(diagram, tmp_path, 400, plant=plant)
    with open(tmp_path / "leg.mcap", "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        ticks = [message.sequence for _, _, message in reader.iter_messages(topics="/tickwork/tick")]
        count = sum(1 for _ in reader.iter_messages())
    assert ticks == list(range(400)) and count == summary.statistics.message_count == sum(
        summary.statistics.channel_message_counts.values()
    )
    assert summary.chunk_indexes and all(
        set(index.message_index_offsets) <= set(summary.channels) for index in summary.chunk_indexes
    )
    data = (tmp_path / "leg.mcap").read_bytes()
    for index in summary.chunk_indexes:
        content = next(chunk for chunk in full_chunks(data) if chunk[0] == index.chunk_start_offset)[1]
        for channel, offset in index.message_index_offsets.items():
            kind, length, number, size = INDEX.unpack_from(data, offset)
            places = struct.unpack_from(f"<{size // 8}Q", data, offset + INDEX.size)
            assert (kind, number) == (7, channel)
            for time, place in zip(places[::2], places[1::2]):
                _, _, found, _, log_time, _ = MESSAGE.unpack_from(content, place)
                assert (found, log_time) == (channel, time)


def test_a_block_in_several_subsystems_of_any_depth_has_a_topic_each(tmp_path):
    class Through(Block):
        u, y = Input("any"), Output("any")

        def step(self, u):
            return u

    with Diagram("deep", rate=100) as diagram:
        signal = Sine().y
        for side in ("left", "right"):
            with subsystem(side):
                Through(name="a")(signal)
                with subsystem("knee"):
                    Through(name="a")(signal)
        CsvRecorder()
    run(diagram, tmp_path, 3)
    found = log(tmp_path / "deep.mcap")
    assert [topic for topic in found.channels if "/can" not in topic] == [
        "/left",
        "/left/knee",
        "/right",
        "/right/knee",
        "/deep",
        "/tickwork/tick",
        "/tickwork/events",
    ]
    assert found.signal("/right/knee a y") == found.signal("/deep sine y")


@pytest.mark.parametrize("count", [0, 1, 5000])
def test_a_long_or_empty_recording_is_one_valid_file(tmp_path, count):
    report = record(plan(tmp_path, sink(CSV, "a", columns("a.x m"))), [row(tick, 1.0) for tick in range(count)])
    found = log(tmp_path / "bench_1.mcap")
    assert len(found.channels["/tickwork/tick"]) == count == report["sinks"]["flight log"]["rows"]
