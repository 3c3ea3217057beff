"""Recordings whose chunks another tool has compressed: read as they were, with a bound on what they expand to."""

import io
import random
import subprocess
import sys

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Attachment, Channel, Chunk, Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

import runtime
from runtime.host.errors import CHECK_FAILED, OK
from runtime.record.storage.chunks import ExpansionLimit, TooLarge, expand
from runtime.record.storage.mcap_file import MESSAGE, MESSAGE_REST
from runtime.record.storage.records import LIBRARY
from tests.runtime.record.recorder.running import leg, run
from tests.runtime.record.storage.test_finishing import content, indexed
from tests.runtime.runs import ROOT, environment
from tests.soaking import soaked

MEBIBYTE = 1 << 20


def compress(path, kind):
    """Write a recording anew with compressed chunks."""
    out, channels, topics = io.BytesIO(), {}, numbers(path)
    writer = Writer(out, chunk_size=2000, compression=kind)
    writer.start(library=LIBRARY)
    for record in StreamReader(io.BytesIO(path.read_bytes())).records:
        if isinstance(record, Attachment):
            writer.add_attachment(0, 0, record.name, record.media_type, record.data)
        elif isinstance(record, Channel) and record.topic not in channels:
            schema = writer.register_schema(record.topic, "protobuf", b"")
            channels[record.topic] = writer.register_channel(record.topic, "protobuf", schema)
        elif isinstance(record, Message):
            writer.add_message(
                channels[topics[record.channel_id]], record.log_time, record.data, record.publish_time, record.sequence
            )
    writer.finish()
    path.write_bytes(out.getvalue())
    return path


def numbers(path):
    """{number: topic} of the channels of a file."""
    return {
        item.id: item.topic for item in StreamReader(io.BytesIO(path.read_bytes())).records if isinstance(item, Channel)
    }


def compressed_chunks(path):
    """(where it begins, where it ends) of every chunk of a file."""
    stream, found, before = io.BytesIO(path.read_bytes()), [], 0
    for record in StreamReader(stream, emit_chunks=True).records:
        if isinstance(record, Chunk):
            found.append((before, stream.tell()))
        before = stream.tell()
    return found


@pytest.fixture(params=soaked([CompressionType.ZSTD, CompressionType.LZ4], but=[0]), ids=["zstd", "lz4"])
def recording(request, command_line):
    diagram, plant = leg()
    run(diagram, command_line.folder, 60, plant=plant)
    return compress(command_line.folder / "leg.mcap", request.param)


def test_a_compressed_recording_reads_and_converts_as_the_plain_one_does(command_line):
    diagram, plant = leg()
    run(diagram, command_line.folder, 60, plant=plant)
    path = command_line.folder / "leg.mcap"
    plain, messages = content(runtime.load(path)), indexed(path)
    for kind in (CompressionType.ZSTD, CompressionType.LZ4):
        compress(path, kind)
        assert len(compressed_chunks(path)) > 3
        trial = runtime.load(path)
        assert trial.complete and content(trial) == plain
        code, out, err = command_line("convert", path, "--to", "mcap", "-o", "plain")
        assert (code, err) == (OK, "") and indexed(command_line.folder / out.strip()) == messages
        code, out, err = command_line("convert", path, "--to", "mcap", "--in-place")
        assert (code, err) == (OK, ""), "a whole file is left as it is"
        command_line("convert", command_line.folder / "plain" / "leg.mcap", "--to", "mcap", "-o", ".")
        path.write_bytes((command_line.folder / "plain" / "leg.mcap").read_bytes())
        (command_line.folder / "plain" / "leg.mcap").unlink()


@pytest.mark.soak
def test_damage_in_a_compressed_chunk_is_a_gap(recording, command_line):
    whole, data, dice = runtime.load(recording), recording.read_bytes(), random.Random(7)
    rows = dict(zip(whole.tick.tolist(), whole.rows))
    begin, end = compressed_chunks(recording)[2]
    reported = 0
    for at in [*range(begin + 1, begin + 60), *(dice.randrange(begin + 60, end) for _ in range(30))]:
        recording.write_bytes(data[:at] + bytes([data[at] ^ 1 << dice.randrange(8)]) + data[at + 1 :])
        trial = runtime.load(recording)
        assert all(
            np.array_equal(rows[tick], row, equal_nan=True) for tick, row in zip(trial.tick.tolist(), trial.rows)
        )
        assert trial.tick[0] == 0 and trial.tick[-1] == whole.tick[-1] and len(trial) > len(whole) - 12
        assert not trial.complete or len(trial) == len(whole) and at >= begin + 53, "each byte of the head is verified"
        if at >= begin + 60 and not trial.complete:  # some bits may differ, and the same comes out of it
            assert f"{recording} is damaged: of its {len(data)} bytes, {begin} to " in trial.trouble
            reported += 1
    assert reported > 25
    recording.write_bytes(data[:begin] + b"\x46" + data[begin + 1 :])  # a record of another kind
    trial = runtime.load(recording)
    assert not trial.complete and 0 < len(trial) < len(whole) and set(trial.tick.tolist()) < set(rows)
    recording.write_bytes(data[: begin + 100] + data[begin + 104 :])
    code, out, err = command_line("convert", recording, "--to", "csv")
    assert code == CHECK_FAILED and f"bytes, {begin} to " in err and " are lost, with the ticks " in err
    recording.write_bytes(data[: end - 5])
    assert "is incomplete: it was truncated" in runtime.load(recording).trouble


@pytest.mark.soak
def test_chunks_of_a_small_file_that_expand_without_end_are_refused_in_bounded_memory(command_line):
    diagram, plant = leg()
    run(diagram, command_line.folder, 60, plant=plant)
    path = compress(command_line.folder / "leg.mcap", CompressionType.ZSTD)
    channel, size = next(
        (item.channel_id, len(item.data))
        for item in StreamReader(io.BytesIO(path.read_bytes())).records
        if isinstance(item, Message) and not numbers(path)[item.channel_id].startswith("/tickwork")
    )
    messages = MESSAGE.pack(5, MESSAGE_REST + size, channel, 0, 0, 0) + bytes(size)
    plain, bomb = messages * (8 * MEBIBYTE // len(messages)), RecordBuilder()
    Chunk(
        compression="zstd",
        data=zstandard.compress(plain),
        message_end_time=0,
        message_start_time=0,
        uncompressed_crc=0,
        uncompressed_size=len(plain),
    ).write(bomb)
    data, end = path.read_bytes(), compressed_chunks(path)[-1][1]
    path.write_bytes(data[:end] + 60 * bomb.end() + data[end:])
    assert path.stat().st_size < 100_000
    # getrusage would count what the parent had before exec
    code = (
        f"import re, runtime; print(runtime.load({str(path)!r}).trouble); "
        "print(re.search(r'VmHWM:\\s+(\\d+)', open('/proc/self/status').read())[1])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=environment(), capture_output=True, text=True)
    trouble, peak = done.stdout.splitlines()
    assert "above the limit of 16 MiB for a file of this size" in trouble
    assert int(peak) < 256 << 10, f"{peak} KiB of memory {done.stderr}"


@pytest.mark.parametrize("kind", ["zstd", "lz4"])
def test_a_chunk_may_expand_to_no_more_than_it_declares_and_its_file_to_a_hundred_times_its_size(kind):
    squeeze = {"zstd": zstandard.compress, "lz4": lz4.frame.compress}[kind]
    part = 9 * (5 * MEBIBYTE // 9)  # records of kind 0 without content
    squeezed = {size: squeeze(bytes(size)) for size in (90, 100, 32 * MEBIBYTE)}

    def chunk(size, declared=None):
        return Chunk(
            compression=kind,
            data=squeezed[size],
            message_end_time=0,
            message_start_time=0,
            uncompressed_crc=0,
            uncompressed_size=size if declared is None else declared,
        )

    with pytest.raises(TooLarge, match="chunk of 67108865 bytes, above the limit of 64 MiB"):
        ExpansionLimit(1 << 40).admit(64 * MEBIBYTE + 1)
    with pytest.raises(TooLarge, match="the limit of 16 MiB for a file of this size"):
        ExpansionLimit(98_000).admit(16 * MEBIBYTE + 1)
    with pytest.raises(ValueError, match="^101 bytes instead of 100$"):
        expand(chunk(32 * MEBIBYTE, 100))
    with pytest.raises(ValueError, match="^100 bytes instead of 101$"):
        expand(chunk(100, 101))
    assert expand(chunk(90)) == bytes(90)
    limit = ExpansionLimit(98_000)
    for size in (90, part, part, part):
        limit.admit(size)
    with pytest.raises(TooLarge):
        limit.admit(part)


def test_chunk_of_a_false_size_is_not_expanded(recording, command_line):
    begin = compressed_chunks(recording)[2][0]
    data = bytearray(recording.read_bytes())
    data[begin + 25 : begin + 33] = (3 << 30).to_bytes(8, "little")
    recording.write_bytes(data)
    code, _, err = command_line("convert", recording, "--to", "csv")
    assert code == CHECK_FAILED and f"leg.mcap is damaged: of its {len(data)} bytes, {begin} to " in err
