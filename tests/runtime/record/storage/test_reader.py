"""A recording is opened without being read. Every chunk is checked before the first value, and read once after that."""

import os

import numpy as np
import pytest
from mcap.reader import make_reader

import runtime
from cext.memory.shared_state import RECORD_EVENT, SharedState
from runtime.host.errors import BadInput
from runtime.record.storage import reader
from tests.runtime.record.recorder.running import CSV, columns, frame, plan, record, row, sink

TICKS, SIGNALS = 8000, 60
BUSES = ["legs", "arms"]


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Recording of several chunks. Signal k of tick n is n + k / 100; a frame a tick and bus."""
    folder, records = tmp_path_factory.mktemp("long"), []
    for tick in range(TICKS):
        time = 5_000_000 * tick
        records += [
            (4, time.to_bytes(8, "little", signed=True)),
            frame(time, 1, tick.to_bytes(4, "little"), bus=1),
            frame(time + 1, 2, bytes([tick % 256]), sent=1),
            row(tick, *(tick + place / 100 for place in range(SIGNALS))),
        ]
    paths = [f"leg{place // 30}/block.x{place} rad" for place in range(SIGNALS)]
    order = plan(folder, sink(CSV, "csv", columns(*paths)), stem="long", buses=BUSES)
    record(order, records, shared=SharedState(1 << 23))
    return folder / "long.mcap"


@pytest.fixture
def loads(monkeypatch):
    """Positions of the chunks that are read."""
    positions, load = [], reader.load

    def counted(descriptor, chunk):
        positions.append(chunk.at)
        return load(descriptor, chunk)

    monkeypatch.setattr(reader, "load", counted)
    return positions


def chunk_indexes(path):
    with open(path, "rb") as file:
        return make_reader(file).get_summary().chunk_indexes


def changed(path, folder, at, data):
    """Copy a recording with other bytes at a position."""
    whole = bytearray(path.read_bytes())
    whole[at : at + len(data)] = data
    copy = folder / "changed.mcap"
    copy.write_bytes(whole)
    return copy


def test_opening_reads_no_chunk_and_a_signal_checks_and_reads_each_chunk_once(path, loads):
    trial = runtime.load(path)
    assert len(trial.signals) == SIGNALS and trial.about["rate"] == 200 and trial.end["end"]["status"] == "ok"
    assert loads == [], "the metadata need no chunk"
    chunks = [index.chunk_start_offset for index in chunk_indexes(path)]
    assert len(trial) == TICKS and sorted(loads) == chunks and len(loads) > 3
    assert trial["leg1/block.x40"].tolist() == [tick + 0.4 for tick in range(TICKS)]
    assert sorted(loads) == sorted([*chunks, *chunks])
    assert trial.time[-1] == (TICKS - 1) / 200 and trial["leg1/block.x40"][7] == 7.4 and trial.complete
    assert len(loads) == 2 * len(chunks), "what was read is kept"


def test_several_signals_are_read_in_one_pass(path, loads):
    trial = runtime.load(path)
    values = trial.read(["leg0/block.x3", "leg1/block.x59"])
    assert values["leg1/block.x59"][100] == 100.59 and values["leg0/block.x3"][100] == 100.03
    assert trial["leg0/block.x3"][-1] == TICKS - 1 + 0.03 and len(loads) == 2 * len(chunk_indexes(path))


def test_arrays_of_read_are_parts_of_one_allocation_and_read_only(path):
    trial = runtime.load(path)
    values = trial.read(trial.names)
    own = trial["leg1/block.x40"]
    for array in values.values():
        assert array.flags.c_contiguous and np.shares_memory(array, trial.rows)
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    own -= own[0]
    assert own[7] == 7.0 and trial["leg1/block.x40"][7] == values["leg1/block.x40"][7] == 7.4


def test_interval_is_read_without_the_rest(path, loads):
    trial = runtime.load(path)
    trial.check()
    loads.clear()
    part = trial.between(10.0, 11.0)
    assert len(part) == 200 and part.tick[0] == 2000 and part.time[-1] == 10.995
    assert part["leg0/block.x1"].tolist() == [tick + 0.01 for tick in range(2000, 2200)]
    assert part.rows.shape == (200, SIGNALS) and set(loads) < {
        index.chunk_start_offset for index in chunk_indexes(path)
    }
    assert [frame.row for frame in part.frames] == [tick for tick in range(200) for _ in BUSES]
    assert len(part.between(10.5, 20.0)) == 100 and len(part.between(50.0, 60.0)) == 0


def test_batches_contain_the_recording_in_order(path):
    trial = runtime.load(path)
    rows, frames = (np.concatenate(arrays) for arrays in zip(*trial.batches()))
    assert np.array_equal(rows[:, 0], trial.tick) and np.array_equal(rows[:, 2:], trial.rows)
    assert frames["row"].tolist() == [tick for tick in range(TICKS) for _ in BUSES]
    assert frames["drain"].tolist() == [1 + tick for tick in range(TICKS) for _ in BUSES]
    assert frames["bus"].tolist() == [1, 0] * TICKS and frames["sent"].tolist() == [0, 1] * TICKS
    assert frames["id"].tolist() == [1, 2] * TICKS and frames["length"].tolist() == [4, 1] * TICKS
    assert [bytes(data)[:4] for data in frames["data"][::2]] == [tick.to_bytes(4, "little") for tick in range(TICKS)]
    assert sum(len(batch.frames) for batch in trial.batches(frames=False)) == 0


def test_damaged_index_does_not_change_what_is_read(path, tmp_path):
    index = chunk_indexes(path)[1]
    whole = runtime.load(path)
    for offset in index.message_index_offsets.values():
        for place, damage in ((8, bytes(1)), (24, b"\xff" * 8), (8, b"\xff" * 40), (24, b"\0" * 7 + b"\x80")):
            trial = runtime.load(changed(path, tmp_path, offset + 15 + place, damage))
            if trial.path.read_bytes() == path.read_bytes():
                continue
            assert np.array_equal(trial["leg0/block.x1"], whole["leg0/block.x1"])
            assert not trial.complete and " are lost, no tick is missing" in trial.trouble


def test_damaged_chunk_is_a_gap_and_what_was_lost_is_reported(path, tmp_path):
    index, whole = chunk_indexes(path)[2], runtime.load(path)
    copy = changed(path, tmp_path, index.chunk_start_offset + 5000, b"damage")
    trial = runtime.load(copy)
    count, ticks = len(trial), trial.tick
    lost = np.flatnonzero(~np.isin(whole.tick, ticks))
    assert 0 < len(lost) < 1500 and count == len(ticks) == TICKS - len(lost)
    assert np.array_equal(trial["leg0/block.x1"], np.delete(whole["leg0/block.x1"], lost)) and not trial.complete
    end = index.chunk_start_offset + index.chunk_length + index.message_index_length - 1
    assert trial.trouble == (
        f"{copy} is damaged: of its {copy.stat().st_size} bytes, {index.chunk_start_offset} to {end} are lost, "
        f"with the ticks {lost[0]} to {lost[-1]} ({lost[0] / 200:g} s to {lost[-1] / 200:g} s)"
    )
    asked_first = runtime.load(copy)
    assert asked_first.trouble == trial.trouble and len(asked_first) == count
    assert sum(len(rows) for rows, _ in runtime.load(copy).batches()) == count


def test_file_that_changes_after_its_check_is_reported(path, tmp_path):
    copy = changed(path, tmp_path, 0, b"\x89")
    trial = runtime.load(copy)
    assert len(trial) == TICKS
    changed(path, tmp_path, chunk_indexes(path)[2].chunk_start_offset + 5000, b"damage")
    with pytest.raises(BadInput, match="changed.mcap has changed while it was read"):
        trial["leg0/block.x1"]


def test_unfinished_file_opens_up_to_its_last_flush(path, tmp_path, loads):
    data, last = path.read_bytes(), chunk_indexes(path)[-1]
    copy = tmp_path / "cut.mcap"
    copy.write_bytes(data[: last.chunk_start_offset + last.chunk_length // 2])
    trial, whole = runtime.load(copy), runtime.load(path)
    assert loads == [], "the chunks before the last one are not read to open it"
    assert 0 < len(trial) < TICKS and "is incomplete: it was truncated" in trial.trouble
    assert np.array_equal(trial.rows, whole.rows[: len(trial)])


def test_frames_of_all_buses_keep_their_order_around_an_event(tmp_path):
    event = RECORD_EVENT, b'{"event": "mark", "tick": 0, "number": 1}'
    drain = 4, (0).to_bytes(8, "little")
    sequence = [1, 0, 0, 1, event, 0, 1, 0, 1, 1, event, 1, 0, None, 0, 1, 0]
    records = [drain]
    for number, item in enumerate(sequence):
        records.append(item if item is event else row(0, 1.0) if item is None else frame(number, 1, b"", bus=item))
    record(plan(tmp_path, sink(CSV, "csv", columns("a.x m")), stem="marked", buses=BUSES), records)
    trial = runtime.load(tmp_path / "marked.mcap")
    assert len(trial.marks) == 2
    assert [(frame.time, frame.bus) for frame in trial.frames] == [
        (number, BUSES[item]) for number, item in enumerate(sequence) if isinstance(item, int)
    ]


def test_table_and_plot_read_the_recording_in_one_pass(path, tmp_path, loads):
    pytest.importorskip("pandas")
    count = len(chunk_indexes(path))
    assert runtime.load(path).table().shape == (TICKS, 1 + SIGNALS) and len(loads) == 2 * count
    loads.clear()
    plots = pytest.importorskip("runtime.record.analysis.plots")
    with open(tmp_path / "plot.png", "wb") as file:
        rows = [["leg0/block.x1", "leg1/block.x31"], ["leg1/block.x59"]]
        plots.over_time({"": runtime.load(path)}, rows, "", file, "png")
    assert len(loads) <= count + count + 1  # the check, the signals, and the events


def test_a_pipe_is_refused_before_it_is_opened(tmp_path):
    os.mkfifo(tmp_path / "run.mcap")
    with pytest.raises(BadInput, match="run.mcap is a pipe"):
        runtime.load(tmp_path / "run.mcap")
