"""The CSV recorder, through a real recorder process."""

import csv
import math
import re
import resource
import struct
import time

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from blocks._plumbing.csv_columns import read_table
from blocks.recorders import CsvRecorder
from cext.memory.shared_state import SharedState
from cext.recording.ring_batch import Batch
from graph import Diagram
from graph.units import canonical
from runtime.host.errors import BadInput
from runtime.record.recorder import RecorderError, RecorderProcess
from runtime.record.recorder.services.csv import CsvWriter
from runtime.record.storage.ascii_units import ascii_name
from runtime.record.storage.files import WholeFile, create
from tests.runtime.record.recorder.running import CSV, Counter, columns, plan, read_csv, record, row, run, sink
from tests.runtime.runs import finished


def written(folder, columns, rows, **parameters):
    report = record(plan(folder, sink(CSV, "csv_recorder", columns, **parameters)), rows)
    assert report["problems"] == []
    return report


def test_the_header_names_time_tick_and_every_signal_with_its_unit_in_ascii(tmp_path):
    signals = columns(
        "left/knee.position rad",
        "left/knee.torque N·m",
        "imu.accel[2] m/s²",
        "left/knee.temperature °C",
        "gait.phase 1",
        "sum.y any",
    )
    written(tmp_path, signals, [row(0, 0, 0, 0, 0, 0, 0)])
    header, _ = read_csv(tmp_path / "bench_1.csv")
    assert header == [
        "time [s]",
        "tick",
        "left/knee.position [rad]",
        "left/knee.torque [N*m]",
        "imu.accel[2] [m/s^2]",
        "left/knee.temperature [degC]",
        "gait.phase",
        "sum.y",
    ]


@pytest.mark.parametrize(
    "unit, name",
    [
        ("N·m", "N*m"),
        ("m/s²", "m/s^2"),
        ("°C", "degC"),
        ("µT", "uT"),
        ("N·m·s/rad", "N*m*s/rad"),
        ("Ω", "ohm"),
        ("1", "1"),
        ("rad", "rad"),
    ],
)
def test_file_headers_carry_units_in_ascii_that_read_back(unit, name):
    assert ascii_name(unit) == name and name.isascii() and canonical(name) == unit


symbols = st.sampled_from(["N", "m", "s", "rad", "A", "kg", "K", "V", "µT", "Ω"])
products = st.dictionaries(symbols, st.integers(-3, 3).filter(bool), min_size=1, max_size=4).map(
    lambda exponents: "·".join(f"{symbol}^{exponent}" for symbol, exponent in exponents.items())
)


@given(products)
def test_every_product_of_units_round_trips_through_ascii(product):
    assert canonical(ascii_name(canonical(product))) == canonical(product)


def test_rows_arrive_in_order_and_ticks_jump_over_missed_ones(tmp_path):
    ticks = [tick for tick in range(1000) if tick not in (17, 500, 501)]
    report = written(tmp_path, columns("a.y m"), [row(tick, 0.5 * tick) for tick in ticks])
    _, rows = read_csv(tmp_path / "bench_1.csv")
    assert [int(cells[1]) for cells in rows] == ticks
    assert [float(cells[0]) for cells in rows] == [tick / 200.0 for tick in ticks]
    assert [float(cells[2]) for cells in rows] == [0.5 * tick for tick in ticks]
    assert report["ticks"] == 997 and report["first_tick"] == 0 and report["last_tick"] == 999


def test_ints_and_bools_are_integers_and_non_finite_values_are_written(tmp_path):
    signals = columns("a.x m", "a.n 1 int", "a.b 1 bool")
    rows = [
        row(0, 2.0, -7, 1),
        row(1, math.nan, 3, 0),
        row(2, -math.inf, math.nan, 1),
        row(3, 1e300, math.inf, math.nan),
    ]
    written(tmp_path, signals, rows)
    assert (tmp_path / "bench_1.csv").read_text().splitlines()[1:] == [
        "0.0,0,2.0,-7,1",
        "0.005,1,nan,3,0",
        "0.01,2,-inf,nan,1",
        "0.015,3,1e300,inf,nan",
    ]


def test_recorder_writes_its_columns_in_given_order(tmp_path):
    signals = columns("a.x m", "a.y s", "a.z rad")
    some, one = sink(CSV, "some", [signals[2], signals[0]], file="some"), sink(CSV, "one", [signals[1]], file="one")
    report = record(plan(tmp_path, sink(CSV, "all", signals), some, one), [row(0, 1.0, 2.0, 3.0)])
    assert read_csv(tmp_path / "some.csv") == (
        ["time [s]", "tick", "a.z [rad]", "a.x [m]"],
        [["0.0", "0", "3.0", "1.0"]],
    )
    assert read_csv(tmp_path / "one.csv")[1] == [["0.0", "0", "2.0"]]
    files = ["bench_1.csv", "some.csv", "one.csv", "bench_1.mcap", "bench_1.json"]
    assert [file["path"] for file in report["files"]] == [str(tmp_path / name) for name in files]


def test_the_delimiter_is_the_users_and_a_name_that_holds_it_is_quoted(tmp_path):
    written(tmp_path, columns("a;b.x m", "a.y m"), [row(0, 1.5, 2.5)], delimiter=";")
    assert (tmp_path / "bench_1.csv").read_text() == 'time [s];tick;"a;b.x [m]";a.y [m]\n0.0;0;1.5;2.5\n'


@pytest.mark.parametrize(
    "name, character", [("tab", "\t"), ("space", " "), ("pipe", "|"), ("semicolon", ";"), ("~", "~")]
)
def test_file_with_any_delimiter_is_read_again(tmp_path, name, character):
    recorder = CsvRecorder(delimiter=name)
    assert recorder.delimiter == character
    written(tmp_path, columns("a.x m", "b.y rad"), [row(0, 1.5, -2.5), row(1, 1e-9, math.nan)], delimiter=character)
    table = read_table(str(tmp_path / "bench_1.csv"))
    assert table.names == ["time", "tick", "a.x", "b.y"] and table.units == ["s", "", "m", "rad"]
    np.testing.assert_array_equal(table.column("a.x"), [1.5, 1e-9])
    np.testing.assert_array_equal(table.column("b.y"), [-2.5, math.nan])


def test_columns_have_names_of_ones_own(tmp_path):
    signals = columns("left/knee.position rad", "left/knee.torque N·m")
    written(tmp_path, signals, [row(0, 1.0, 2.0)], names={"left/knee.position": "knee_angle"})
    assert read_csv(tmp_path / "bench_1.csv")[0] == ["time [s]", "tick", "knee_angle", "left/knee.torque [N*m]"]


def test_name_for_a_signal_that_is_not_recorded_is_refused(tmp_path):
    signals = columns("left/knee.position rad")
    plans = plan(tmp_path, sink(CSV, "csv_recorder", signals, names={"left/knee.positon": "angle"}))
    with pytest.raises(RecorderError, match="names: 'left/knee.positon' is not a recorded signal; did you mean"):
        record(plans, [row(0, 1.0)])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("names", [{"a.x": "b", "a.y": "b"}, {"a.x": "tick"}, {"a.x": "a.y [m]"}])
def test_one_name_for_two_columns_is_refused(tmp_path, names):
    plans = plan(tmp_path, sink(CSV, "csv_recorder", columns("a.x m", "a.y m"), names=names))
    with pytest.raises(RecorderError, match=f"names: '{re.escape(names['a.x'])}' is the name of more than one column"):
        record(plans, [row(0, 1.0, 2.0)])
    assert list(tmp_path.iterdir()) == []


def test_text_has_states_by_name_and_each_event_in_the_row_that_follows_or_the_last_one(tmp_path):
    walk = tmp_path / "walk.py"
    walk.write_text(
        "from blocks.recorders import CsvRecorder\n"
        "from blocks.clock import Clock\n"
        "from blocks.states import StateMachine\n"
        "from graph import Block, Diagram, Input, Output\n\n\n"
        "class Failing(Block):\n"
        "    u = Input('s')\n"
        "    y = Output('s')\n\n"
        "    def step(self, u):\n"
        "        if u >= 0.05:\n"
        "            raise ValueError('it broke')\n"
        "        return u\n\n\n"
        "with Diagram('walk', rate=100) as diagram:\n"
        "    time = Clock().time\n"
        "    gait = StateMachine(takes={'t': 's'}, states={'swing': {}, 'stance': {}},\n"
        "                        transitions=[('swing', 'stance', 't >= 0.02')], name='gait')\n"
        "    gait(t=time)\n"
        "    Failing(name='failing')(time)\n"
        "    CsvRecorder(record='gait', text=True, file='walk')\n"
    )
    assert finished(walk, "--fast", "--duration", "1", "--record", tmp_path, cwd=tmp_path).returncode == 3
    lines = list(csv.DictReader((tmp_path / "walk.csv").open()))
    assert [line["gait.state"] for line in lines] == ["swing", "swing", "stance", "stance", "stance"]
    assert [line["events"] for line in lines[:-1]] == [""] * 4
    assert "failing" in lines[-1]["events"]


def test_event_that_follows_the_last_flushed_row_is_in_that_row(tmp_path):
    signals = columns("a.x m")
    writer = CsvWriter(plan(tmp_path), sink(CSV, "csv_recorder", signals, text=True, flush_rows=1))
    writer.open()
    writer.event({"event": "mark", "number": 1, "tick": 0})
    writer.row(0, 0.0, [1.0])
    writer.row(1, 0.005, [2.0])
    writer.flush()
    writer.event({"event": "mark", "number": 2, "tick": 2})
    writer.event({"event": "end", "status": "fault, of a drive", "tick": 2})
    writer.close()
    assert (tmp_path / "bench_1.csv").read_text().splitlines() == [
        "time [s],tick,a.x [m],events",
        "0.0,0,1.0,mark 1",
        '0.005,1,2.0,"mark 2; end: fault, of a drive, tick 2"',
    ]


def test_existing_files_are_never_overwritten(tmp_path):
    (tmp_path / "bench_1.csv").write_text("dear data\n")
    (tmp_path / "mine.csv").write_text("dearer data\n")
    signals = columns("a.x m")
    for _ in range(2):
        record(plan(tmp_path, sink(CSV, "a", signals), sink(CSV, "b", signals, file="mine")), [row(0, 1.0)])
    assert (tmp_path / "bench_1.csv").read_text() == "dear data\n" and (
        tmp_path / "mine.csv"
    ).read_text() == "dearer data\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "bench_1-2.csv",
        "bench_1-2.json",
        "bench_1-2.mcap",
        "bench_1-3.csv",
        "bench_1-3.json",
        "bench_1-3.mcap",
        "bench_1.csv",
        "mine-2.csv",
        "mine-3.csv",
        "mine.csv",
    ]


def test_without_a_folder_no_file_is_written_but_the_run_is_reported(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    report = record(plan(None, sink(CSV, "csv_recorder", columns("a.x m"))), [row(0, 1.0)])
    assert report["files"] == [] and report["ticks"] == 1 and list(tmp_path.iterdir()) == []


def test_rows_are_written_while_trigger_signal_is_true(tmp_path):
    kept = sink(CSV, "csv_recorder", columns("mocap.on 1", "a.x m"), during="mocap.on")
    report = record(
        plan(tmp_path, kept), [row(tick, on, 0.5 * tick) for tick, on in enumerate((0.0, 1.0, 1.0, math.nan, 0.0, 1.0))]
    )
    [file] = tmp_path.glob("*.csv")
    assert [line.split(",")[1] for line in file.read_text().splitlines()[1:]] == ["1", "2", "5"]
    assert report["ticks"] == 6  # and the flight recorder has them all


def test_trigger_signal_must_be_recorded(tmp_path):
    writer = CsvWriter(plan(tmp_path), sink(CSV, "a", columns("mocap.on 1"), during="mocap.off"))
    with pytest.raises(BadInput, match="^during: 'mocap.off' is not a recorded signal; did you mean 'mocap.on'?"):
        writer.open()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "file, made", [("mine", "mine.csv"), ("mine.csv", "mine.csv"), ("walk µ.2", "walk µ.2.csv"), ("", "bench_1.csv")]
)
def test_file_name_is_used_with_or_without_suffix(tmp_path, file, made):
    writer = CsvWriter(plan(tmp_path), sink(CSV, "a", columns("a.x m"), file=file))
    writer.open()
    writer.close()
    assert [path.name for path in tmp_path.iterdir()] == [made]


@pytest.mark.parametrize("file", ["sub/mine", "../mine", "/tmp/mine", ".", "..", "mine/"])
def test_file_is_written_only_to_recording_folder(tmp_path, file):
    writer = CsvWriter(plan(tmp_path), sink(CSV, "a", columns("a.x m"), file=file))
    with pytest.raises(
        BadInput, match=f"^file: '{file}' is not a file name. The file is written to the folder of the recording"
    ):
        writer.open()
    assert not list(tmp_path.iterdir())


@settings(deadline=None)
@given(st.lists(st.floats(), min_size=1, max_size=5))
@example([5e-324, -0.0, 1e16, 0.1 + 0.2, 1.7976931348623157e308])
def test_every_double_reads_back_as_the_same_double(tmp_path_factory, values):
    folder = tmp_path_factory.mktemp("csv")
    writer = CsvWriter(plan(folder), sink(CSV, "a", columns(*(f"a.x{i} m" for i in range(len(values))))))
    writer.open()
    writer.records(Batch([row(3, *values)]))
    writer.close()
    _, rows = read_csv(folder / "bench_1.csv")
    for value, text in zip(values, rows[0][2:], strict=True):
        assert (
            math.isnan(float(text)) if math.isnan(value) else struct.pack("d", float(text)) == struct.pack("d", value)
        )


def test_rows_reach_the_file_every_flush_rows_rows_and_only_whole_ones(tmp_path):
    writer = CsvWriter(plan(tmp_path), sink(CSV, "a", columns("a.x m"), flush_rows=50))
    writer.open()
    for tick in range(120):
        writer.records(Batch([row(tick, 1.0 / (tick + 3))]))
    assert len(read_csv(tmp_path / "bench_1.csv")[1]) == 100
    writer.flush()
    assert len(read_csv(tmp_path / "bench_1.csv")[1]) == 120
    writer.close()


def test_a_line_truncated_by_a_full_disk_is_removed(tmp_path):
    file = WholeFile(*create(str(tmp_path / "x"), ".csv"))
    file.write("first\n")
    file.flush()
    file.write("second\n")
    file.write("third\n")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (15, hard))  # the kernel takes 15 bytes and then says EFBIG
    try:
        with pytest.raises(OSError):
            file.flush()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert (tmp_path / "x.csv").read_text() == "first\nsecond\n"
    file.close()


def test_device_time_is_used_if_requested(tmp_path):
    shared = SharedState(1 << 20)
    with Diagram("clocked", rate=200) as diagram:
        Counter(name="counter")
        CsvRecorder(time="device")
    began = time.time()
    run(diagram, tmp_path, 20, virtual=False, shared=shared)
    header, rows = read_csv(tmp_path / "clocked.csv")
    times = [float(cells[0]) for cells in rows]
    assert header[0] == "time [s]" and began < times[0] < time.time()
    zero = (shared.wall + shared.first_tick) * 1e-9
    assert [time - zero for time in times] == pytest.approx([int(cells[1]) / 200 for cells in rows], abs=1e-6)


@pytest.mark.parametrize("first", [True, False])
def test_file_that_a_recorder_is_writing_is_not_replaced(tmp_path, first):
    """Neither by a second recorder of the same run nor by another run."""
    sinks = [sink(CSV, path, columns("a.x m"), file="mine", overwrite=True) for path in ("one", "two")]
    sinks[0]["parameters"]["overwrite"] = first
    with pytest.raises(RecorderError, match=r"two cannot start: another recorder is writing this file: .*mine\.csv$"):
        record(plan(tmp_path / "both", *sinks), [row(0, 1.0)])
    shared = SharedState()
    writing = RecorderProcess(shared)
    writing.configure(plan(tmp_path, sinks[0]))
    with pytest.raises(RecorderError, match="two cannot start"):
        record(plan(tmp_path, sinks[1]), [row(0, 1.0)])
    assert shared.push(*row(0, 2.0))
    shared.close()
    report = writing.finish()
    notes = [file["note"] for file in report["files"]]
    assert notes[:2] == ["1 row of 1 signal", "1 tick of 1 signal, 0 frames"] and not report["problems"]
    assert read_csv(tmp_path / "mine.csv")[1] == [["0.0", "0", "2.0"]]


def test_file_is_not_replaced_by_a_run_that_does_not_start(tmp_path):
    (tmp_path / "mine.csv").write_text("of the run before\n")
    sinks = [sink(CSV, name, columns("a.x m"), file="mine", overwrite=True) for name in ("one", "two")]
    with pytest.raises(RecorderError, match="two cannot start"):
        record(plan(tmp_path, *sinks), [row(0, 1.0)])
    assert (tmp_path / "mine.csv").read_text() == "of the run before\n"
    record(plan(tmp_path, sinks[0]), [])
    assert read_csv(tmp_path / "mine.csv") == (["time [s]", "tick", "a.x [m]"], [])


def test_file_is_replaced_only_if_requested(tmp_path):
    for number in range(2):
        record(plan(tmp_path, sink(CSV, "csv", columns("a.x m"), file="mine", overwrite=True)), [row(0, float(number))])
    assert sorted(path.name for path in tmp_path.glob("*.csv")) == ["mine.csv"]
    assert read_csv(tmp_path / "mine.csv")[1] == [["0.0", "0", "1.0"]]
