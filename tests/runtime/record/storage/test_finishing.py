"""Recordings whose recorder was killed become whole files, of which nothing is lost, and the original stays."""

import fcntl
import io
import os
import random
import signal
import subprocess
import zlib
from importlib.util import find_spec

import numpy as np
import pytest
from mcap.reader import make_reader

import runtime
from runtime.host.errors import CHECK_FAILED, OK, BadInput
from runtime.record.export import convert
from runtime.record.storage.mcap_file import CHUNK_HEADS, head_space
from runtime.record.storage.records import walk
from runtime.record.storage.repair import RepairFailed, finish
from tests.runtime.record.recorder.rerun.test_rerun import program
from tests.runtime.record.recorder.running import CSV, columns, frame, leg, plan, record, row, run, sink
from tests.runtime.record.recorder.test_mcap import unfinished
from tests.runtime.runs import KNEE_EXO, descendant, started, writer_of
from tests.runtime.terminals import patient

BUSES = ["legs", "arms"]


def part(folder, stem, ticks, number=1, compression="zstd"):
    """A recording with a frame a bus and tick, and one that is sent before the first drain."""
    records = [frame(0, 0x99, b"first", sent=1)]
    for tick in ticks:
        time = 1_000_000 * tick
        records += [
            (4, time.to_bytes(8, "little", signed=True)),
            frame(time, 1, bytes([tick % 256])),
            frame(time + 1, 2, b"", bus=1),
            row(tick, tick / 3.0),
        ]
    record(
        plan(
            folder,
            sink(CSV, "csv", columns("left/knee.position rad")),
            stem=stem,
            buses=BUSES,
            part=number,
            compression=compression,
        ),
        records,
    )
    return folder / f"{stem}.mcap"


def content(trial):
    return (
        trial.tick.tolist(),
        trial.rows.tobytes(),
        trial.frames,
        trial.events,
        trial.end,
        trial.diagram,
        {**trial.about, "part": 1},
    )


def killed(data, cut, older=None):
    """Return a recording of one uncompressed chunk as kill -9 leaves it, with the messages up to a position flushed.

    cut, older : of this flush and of an older one, from the end of the file
    """
    [index] = make_reader(io.BytesIO(data)).get_summary().chunk_indexes
    begin = index.chunk_start_offset + CHUNK_HEADS[""].size
    cuts = [cut, older or cut]
    sizes = [max(at for at, _, _ in walk(io.BytesIO(data[begin : len(data) + cut]), 0)) for cut in cuts]
    newest, first = ((size, zlib.crc32(data[begin : begin + size])) for size in sizes)
    room = head_space("", newest, first, newest[0])
    return data[: index.chunk_start_offset] + room + data[begin : begin + newest[0]]


def holds(after, before):
    """Whether a repaired file has all that could be read of it before; it may have more, behind a damaged record."""
    series, single = zip(after[:4], before[:4]), zip(after[4:], before[4:])
    return all(more[: len(least)] == least for more, least in series) and all(b in (None, a) for a, b in single)


def converted(command_line, *words):
    code, out, err = command_line("convert", *words)
    assert code == OK, err
    return [command_line.folder / line for line in out.splitlines()], err


def indexed(path):
    """Messages that the mcap package's own reader finds by the index."""
    reader = make_reader(io.BytesIO(path.read_bytes()), validate_crcs=True)
    assert reader.get_summary().chunk_indexes
    return [
        (channel.topic, message.log_time, message.data)
        for _, channel, message in reader.iter_messages(log_time_order=False)
    ]


def test_a_finished_recording_is_copied_to_the_byte(command_line):
    diagram, plant = leg()
    run(diagram, command_line.folder, 12, plant=plant)
    [path], err = converted(command_line, "leg.mcap", "--to", "mcap")
    assert (
        path.name == "leg-2.mcap" and err == "" and path.read_bytes() == (command_line.folder / "leg.mcap").read_bytes()
    )


def test_a_truncated_file_is_repaired_to_a_file_that_viewers_open(command_line):
    diagram, plant = leg()
    run(diagram, command_line.folder, 12, plant=plant, compression="none")
    cut = command_line.folder / "leg.mcap"
    cut.write_bytes(unfinished(cut.read_bytes())[:-2500])
    before, data = runtime.load(cut), cut.read_bytes()
    [path], err = converted(command_line, "leg.mcap", "--to", "mcap")
    assert (
        err.startswith("tickwork: leg.mcap is unfinished, and complete up to its last flush")
        and cut.read_bytes() == data
    )
    assert content(runtime.load(path)) == content(before) and not runtime.load(path).complete
    assert [name for name, _, _ in indexed(path)].count("/tickwork/tick") == len(before) > 5
    [same], err = converted(command_line, "leg.mcap", "--to", "mcap", "--in-place")
    assert same == cut and content(runtime.load(cut)) == content(before) and indexed(cut) == indexed(path)
    path.write_bytes(cut.read_bytes())
    [again], err = converted(command_line, "leg.mcap", "--to", "mcap", "--in-place")
    assert (
        again == cut
        and cut.read_bytes() == path.read_bytes()
        and ("was completed later: its recorder was killed, or it was truncated") in err
    )


@pytest.mark.soak
def test_after_kill_9_of_every_process_the_file_can_be_repaired(command_line):
    folder = command_line.folder
    run = started(KNEE_EXO, "--duration", "60", "--record", folder, cwd=folder)
    [path] = patient(lambda: list(folder.glob("*.mcap")))
    patient(lambda: path.stat().st_size > 300_000)
    for pid in (descendant(run.pid, "tickwork-parts"), writer_of(run.pid), run.pid):
        os.kill(pid, signal.SIGKILL)
    run.communicate()
    before = runtime.load(path)
    assert len(before) > 100 and not before.complete and before.unfinished and not before.unverified
    [whole], err = converted(command_line, path, "--to", "mcap")
    assert "is unfinished, and complete up to its last flush" in err and content(runtime.load(whole)) == content(before)
    assert [name for name, _, _ in indexed(whole)].count("/tickwork/tick") == len(before)
    [same], err = converted(command_line, path, "--to", "mcap", "--in-place")
    assert content(runtime.load(same)) == content(before)
    if find_spec("rerun"):
        done = subprocess.run([program(), "mcap", "check", str(same)], capture_output=True, text=True, timeout=60)
        assert done.returncode == 0 and "/left" in done.stdout, done.stdout + done.stderr


@pytest.mark.parametrize("further", [pytest.param(0, marks=pytest.mark.soak), 10])
def test_parts_are_joined_to_one_recording(command_line, further):
    """further : ticks that a recorder which was stopped had written, and the next one did too."""
    folder = command_line.folder
    first = part(folder, "cut", range(110 + further), compression="none")
    first.write_bytes(killed(first.read_bytes(), -9000 if further else -10000))
    last = len(runtime.load(first)) - further
    part(folder, "cut_part2", range(last, 200), number=2)
    part(folder, "cut_part3", range(200, 300), number=3)
    before, names = runtime.load(first), {path.name: path.read_bytes() for path in folder.iterdir()}
    assert len(before.parts) == 3 and before.tick.tolist() == list(range(300)) and before.complete
    [path], err = converted(command_line, "cut.mcap", "--to", "mcap", "-o", "out")
    whole = runtime.load(path)
    assert path.name == "cut.mcap" and len(whole.parts) == 1 and whole.complete and err == ""
    assert content(whole) == content(before) and len(indexed(path)) > 3 * 300
    assert {name: (folder / name).read_bytes() for name in names} == names
    paths, err = converted(command_line, "cut.mcap", "--to", "mcap", "--in-place")
    assert [path.name for path in paths] == ["cut.mcap", "cut_part2.mcap", "cut_part3.mcap"] and content(
        runtime.load(first)
    ) == content(before)


def test_recording_with_empty_first_part_begins_with_second(command_line):
    (command_line.folder / "late.mcap").write_bytes(b"")
    part(command_line.folder, "late_part2", range(5), number=2)
    [path], err = converted(command_line, "late.mcap", "--to", "mcap")
    assert (
        path.name == "late-2.mcap"
        and runtime.load(path).about["part"] == 1
        and np.array_equal(runtime.load(path).tick, np.arange(5))
    )


def test_a_damaged_file_is_copied_up_to_the_defect_but_not_completed_in_place(command_line):
    path = part(command_line.folder, "torn", range(100), compression="none")
    whole = path.read_bytes()
    data = killed(whole, -5000, 9_000 - len(whole))
    path.write_bytes(data[:10_000] + data[10_005:])
    code, out, err = command_line("convert", "torn.mcap", "--to", "mcap")
    copy = command_line.folder / out.strip()
    assert (
        code == CHECK_FAILED
        and "torn.mcap is damaged: of its " in err
        and np.array_equal(runtime.load(copy).tick, runtime.load(path).tick)
        and len(runtime.load(copy)) > 10
    )
    code, out, err = command_line("convert", "torn.mcap", "--to", "mcap", "--in-place")
    assert (
        code == 2
        and "`convert` writes the undamaged parts into a new file" in err
        and path.read_bytes() == data[:10_000] + data[10_005:]
    )


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(3))
def test_files_with_random_content_are_completed_without_loss_or_not_changed(command_line, seed):
    diagram, plant = leg()
    run(diagram, command_line.folder, 12, plant=plant)
    whole, order, path = (
        (command_line.folder / "leg.mcap").read_bytes(),
        random.Random(seed),
        command_line.folder / "torn.mcap",
    )
    refused = 0
    for _ in range(300):
        data = bytearray(order.choice([whole, unfinished(whole)]))
        for _ in range(order.choice([1, 1, 3])):
            at, length = order.randrange(len(data)), order.randrange(1, 30)
            data[at : at + order.choice([0, 1, length])] = order.choice(
                [b"", order.randbytes(1), order.randbytes(length)]
            )
        path.write_bytes(data)
        try:
            before = content(runtime.load(path))
            made = convert(runtime.load(path), "mcap", str(command_line.folder / "copy"))
            os.unlink(made)
        except BadInput:
            before = None
        try:
            finish(path)
        except RepairFailed:
            assert path.read_bytes() == data
            refused += 1
        else:
            assert before is None or holds(content(runtime.load(path)), before)
    assert 50 < refused < 250


def with_checksum(data):
    """Return a file with the right checksum of its about.json."""
    at, _, body = next(record for record in walk(io.BytesIO(data[8:]), 8) if b"about.json" in record[2])
    end = at + len(body)
    return data[: end - 4] + zlib.crc32(body[9:-4]).to_bytes(4, "little") + data[end:]


def test_recording_without_signal_metadata_is_reported(command_line):
    path = part(command_line.folder, "a", range(3))
    data = path.read_bytes()
    for old, new, told in (
        (b'"path"', b'"pith"', "its about.json does not list the signals"),
        (b"left/knee", b"left\\nkne", "its about.json does not list the signals"),  # another line, of JSON
        (b"left/knee", b"lift/knee", "its rows do not match the signals in its about.json"),
    ):
        path.write_bytes(with_checksum(data.replace(old, new, 1)))
        assert command_line.refused("convert", "a.mcap", "--to", "csv") == f"a.mcap is damaged: {told}"


def test_invalid_request_is_reported_in_one_line(command_line):
    path = part(command_line.folder, "a", range(3))
    assert command_line.refused("convert", path, "--to", "mcap", "--rate", "50") == (
        "--to mcap does not resample: use --rate with the other formats"
    )
    for words in (["--to", "csv"], ["--to", "mcap,csv"], ["--to", "mcap", "-o", "out"], ["--opensim"]):
        assert (
            command_line.refused("convert", path, *words, "--in-place")
            == "--in-place requires --to mcap and excludes other formats and -o"
        )
    with open(path, "rb") as recorder:
        fcntl.flock(recorder, fcntl.LOCK_EX)
        assert command_line.refused("convert", path, "--to", "mcap", "--in-place") == "a.mcap is still being recorded"
