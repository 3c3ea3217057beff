"""Recordings in other formats, as readers of those formats find them: every sample, in order, to the bit."""

import json
import math
import os
import re
import struct
import sys
from pathlib import Path

import numpy as np
import pytest

import runtime
from cext.memory.shared_state import SharedState
from runtime.host.errors import BAD_INPUT, CHECK_FAILED, OK, BadInput
from runtime.record.export import FORMATS, convert, xdf
from tests.checkout import assert_one_line, copy_packages, python
from tests.runtime.record.recorder.running import CSV, columns, frame, plan, record, row, sink
from tests.runtime.runs import KNEE_EXO, finished

ODD = [0.1, -0.0, 5e-324, 1.7976931348623157e308, math.inf, -math.inf, math.nan, 1 / 3, -2.2250738585072014e-308]
SIGNALS = (
    "left/knee.position rad",
    "left/imu.gyro[0] rad/s",
    "left/imu.gyro[1] rad/s",
    "left/knee.fault 1 int",
    "on.y 1 bool",
    "left/knee.torque N·m",
)


def rows():
    for tick, value in enumerate(ODD * 30):
        yield tick + (tick > 100), value, -value, ODD[tick % 7], tick * 1000, tick % 2, float(tick)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("odd")
    metadata = {"trial": {"subject": "S03"}}
    order = plan(folder, sink(CSV, "csv", columns(*SIGNALS)), stem="odd", metadata=metadata, compression="none")
    record(order, [row(*values) for values in rows()])
    return folder / "odd.mcap"


def bits(values):
    """Doubles as whole numbers. All NaN are one."""
    return [struct.pack("<d", value) if value == value else b"nan" for value in values]


def same(found, path):
    trial = runtime.load(path)
    assert bits(np.ravel(found["time"])) == bits(trial.time)
    for name in trial.signals:
        assert bits(np.ravel(found[name])) == bits(np.ravel(trial[name])), name


def converted(command_line, recording, kind, *words):
    code, out, err = command_line("convert", recording, "--to", kind, "-o", command_line.folder / "out", *words)
    assert (code, err) == (OK, "")
    return out.strip()


def test_converted_csv_equals_the_recorders_byte_for_byte(command_line, recording):
    path = converted(command_line, recording, "csv")
    assert open(path, "rb").read() == recording.with_suffix(".csv").read_bytes()


def test_parquet_keeps_every_sample_with_type_and_unit(command_line, recording):
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(converted(command_line, recording, "parquet"))
    same({name: table[name].to_numpy(zero_copy_only=False) for name in table.column_names}, recording)
    assert [
        str(table.schema.field(name).type) for name in ("tick", "left/knee.fault", "on.y", "left/knee.position")
    ] == ["int64", "int64", "bool", "double"]
    assert (
        table.schema.field("left/knee.torque").metadata[b"unit"].decode() == "N·m"
        and b"S03" in table.schema.metadata[b"tickwork"]
    )
    assert np.array_equal(table["tick"].to_numpy(), runtime.load(recording).tick)


def test_matlab_has_a_nested_struct_with_units_and_time(command_line, recording):
    io = pytest.importorskip("scipy.io")
    trial = io.loadmat(converted(command_line, recording, "mat"), simplify_cells=True)["trial"]
    gyro = trial["left"]["imu"]["gyro"]
    same(
        {
            "time": trial["time"],
            "left/knee.position": trial["left"]["knee"]["position"],
            "left/imu.gyro[0]": gyro[:, 0],
            "left/imu.gyro[1]": gyro[:, 1],
            "left/knee.fault": trial["left"]["knee"]["fault"],
            "on.y": trial["on"]["y"],
            "left/knee.torque": trial["left"]["knee"]["torque"],
        },
        recording,
    )
    assert (
        trial["units"]["left"]["knee"]["torque"] == "N*m" and trial["paths"]["left"]["imu"]["gyro"] == "left/imu.gyro"
    )
    assert (
        trial["fields"]["subject"] == "S03"
        and trial["left"]["knee"]["fault"].dtype == np.int64
        and trial["rate"] == 200
    )


def test_matlab_names_are_valid_and_unique(command_line, tmp_path):
    io = pytest.importorskip("scipy.io")
    long = "x" * 70
    signals = ("öl/for.1 m", "äl/for.1 m", "time.y m", f"{long}1.y m", f"{long}2.y m", "a.b m", "a m", "a.b.c m")
    said = {"trial": {"größe": "1.8", "grüße": "viele"}}
    record(
        plan(tmp_path, sink(CSV, "csv", columns(*signals)), stem="names", metadata=said),
        [row(0, *range(8)), row(1, *range(8))],
    )
    trial = io.loadmat(converted(command_line, tmp_path / "names.mcap", "mat"), simplify_cells=True)["trial"]
    found = {}

    def walk(values, paths):
        for name, value in values.items():
            assert name.isidentifier() and len(name) <= 63 and name.isascii()
            if isinstance(value, dict):
                walk(value, paths[name])
            else:
                found[paths[name]] = value[0]

    own = ("time", "tick", "units", "paths", "fields", "rate")
    walk({name: value for name, value in trial.items() if name not in own}, trial["paths"])
    assert found == dict(zip((text.split()[0] for text in signals), range(8)))
    assert trial["fields"] == {"gr__e": "1.8", "gr__e_2": "viele"}


def table(path):
    """(header lines, names, rows) of a file for OpenSim."""
    head, _, body = open(path, encoding="utf-8").read().partition("endheader\n")
    lines = [line.split("\t") for line in body.splitlines()]
    return head.splitlines(), lines[0], [[float(word) for word in line] for line in lines[1:]]


def test_opensim_export_has_all_signals_at_even_times_and_reports_filled_gaps(command_line, recording):
    code, out, err = command_line("convert", recording, "--opensim", "-o", command_line.folder / "out")
    assert code == OK
    for kind in ("sto", "mot"):
        assert f"tickwork: odd.{kind}: 1 missed tick filled in: OpenSim requires equally spaced times\n" in err
    sto, mot = out.split()
    trial = runtime.load(recording)
    there = [tick for tick in range(len(trial) + 1) if tick != 101]
    for path, names in ((sto, list(trial.signals)), (mot, ["left/knee.position"])):
        head, found, values = table(path)
        assert head[1:5] == ["version=1", f"nRows={len(trial) + 1}", f"nColumns={1 + len(names)}", "inDegrees=no"]
        assert found == ["time", *names] and [row[0] for row in values] == [
            tick / 200 for tick in range(len(trial) + 1)
        ]
        for column, name in enumerate(names, 1):
            assert np.isfinite([row[column] for row in values]).all(), "OpenSim's reader ends at any other cell"
            known = np.isfinite(trial[name].astype(float))
            found_there = np.array([values[tick][column] for tick in there])
            assert bits(found_there[known]) == bits(trial[name][known])  # what was recorded is to the bit
    assert sto.endswith(".sto") and mot.endswith(".mot") and "units=s\trad\trad/s" in open(sto, encoding="utf-8").read()
    column = list(trial.signals).index("left/knee.torque") + 1
    assert table(sto)[2][101][column] == pytest.approx(0.5 * (table(sto)[2][100][column] + table(sto)[2][102][column]))


def test_opensim_file_has_only_numbers_and_what_was_filled_in_is_reported(command_line):
    """A time since the first strike is infinite before it; a sensor has no value at first, and another one never."""
    signals = (
        "gait/events.elapsed s",
        "imu.angle rad",
        "imu.lost rad",
        "gait/phase.value 1",
        "gait/events.count 1 int",
    )
    rows = [row(tick, np.inf if tick < 30 else tick / 200, np.nan if tick < 5 else 0.1 * tick, np.nan, 0.5,
                np.nan if tick == 9 else tick // 10) for tick in range(100)]  # fmt: skip
    record(plan(command_line.folder, sink(CSV, "csv", columns(*signals)), stem="walk"), rows)
    code, out, err = command_line("convert", "walk.mcap", "--opensim")
    sto, mot = (command_line.folder / name for name in out.split())
    for line in (
        "walk.sto: gait/events.elapsed: 30 samples with nan or inf filled in from the samples beside them",
        "walk.sto: imu.angle: 5 samples with nan or inf filled in",
        "walk.sto: imu.lost is left out: it has no number",
        "walk.sto: gait/events.count: 1 sample with nan or inf filled in",
        "walk.mot: imu.angle: 5 samples",
    ):
        assert line in err
    assert code == OK and table(mot)[1] == ["time", "imu.angle"]
    _, names, values = table(sto)
    assert names == ["time", *(text.split()[0] for text in signals if "lost" not in text)]
    assert len(values) == 100 and np.isfinite(values).all()
    found = np.array(values)
    assert (found[:31, 1] == 30 / 200).all() and (found[:6, 2] == 0.5).all() and found[9, 4] == 0
    opensim = pytest.importorskip("opensim", reason="needs the package opensim: pip install opensim")
    assert opensim.Storage(str(sto)).getSize() == opensim.TimeSeriesTable(str(sto)).getNumRows() == 100


def test_signals_get_the_names_of_coordinates(command_line, recording):
    names = command_line.folder / "names.toml"
    names.write_text('"left/knee.position" = "knee_angle_l"\n"left/imu.gyro[1]" = "turn"\n')
    code, out, _ = command_line(
        "convert", recording, "--to", "sto", "--names", names, "-o", command_line.folder / "out"
    )
    trial = runtime.load(recording)
    assert code == OK and table(out.strip())[1] == [
        "time",
        *({"left/knee.position": "knee_angle_l", "left/imu.gyro[1]": "turn"}.get(name, name) for name in trial.signals),
    ]
    assert "left/imu.gyro[1] is in rad/s: .mot contains coordinates" in command_line.refused(
        "convert", recording, "--to", "mot", "--names", names
    )
    names.write_text('"left/knee.position" = "knee_angle_l"\n')
    _, out, _ = command_line(
        "convert", recording, "--to", "mot", "--rate", "100", "--names", names, "-o", command_line.folder / "out"
    )
    head, found, values = table(out.strip())
    assert found == ["time", "knee_angle_l"] and np.allclose(np.diff([row[0] for row in values]), 0.01)


@pytest.mark.parametrize(
    "text, told",
    [
        (
            '"left/knee.positoin" = "k"',
            "odd.mcap has no signal 'left/knee.positoin': did you mean 'left/knee.position'?",
        ),
        ('left/knee.position = "k"', "invalid TOML: "),
        (
            'knee.position = "k"',
            '\'knee\' has no coordinate name; write "left/knee.position" = "knee_angle_l", both in quotes',
        ),
        ('"left/knee.position" = 3', "'left/knee.position' has no coordinate name"),
        ('"left/knee.position" = "knee angle"', "'knee angle' is not a valid column name"),
        ('"left/knee.position" = ""', "'' is not a valid column name"),
        ('"left/knee.position" = "time"', "'time' is already the name of the time"),
        ('"left/knee.position" = "k"\n"left/knee.torque" = "k"', "'k' is already the name of 'left/knee.position'"),
        ("", "no signals"),
        (b"\xff", "not UTF-8 text"),
        (None, "No such file or directory"),
    ],
)
def test_unknown_names_are_reported_in_one_line(command_line, recording, text, told):
    names = command_line.folder / "names.toml"
    if text is not None:
        names.write_bytes(text if isinstance(text, bytes) else text.encode())
    refused = command_line.refused("convert", recording, "--to", "sto", "--names", names)
    assert refused.startswith("--names ") and told in refused and "\n" not in refused


def test_names_are_for_opensim(command_line, recording):
    assert command_line.refused("convert", recording, "--to", "csv", "--names", "x") == (
        "--names requires an OpenSim format: add --to sto, --to mot or --opensim"
    )


def test_opensims_older_reader_reads_one_name_per_column(command_line, tmp_path):
    """It parts the line of names at spaces as well as tabs, and reads settings from every line of the header with = in
    it.
    """
    signals = [
        {**column, "path": path}
        for column, path in zip(columns(*["a.x m"] * 4), ("leg/a b.x", "leg/a_b.x", "leg/a\u2003b.x", "c.x"))
    ]
    record(plan(tmp_path, sink(CSV, "csv", signals), stem="names", name="a=b"), [row(0, *range(4))])
    lines = open(converted(command_line, tmp_path / "names.mcap", "sto"), encoding="utf-8").read().splitlines()
    head = dict(line.split("=") for line in lines[1 : lines.index("endheader")])
    names, values = (line.split() for line in lines[lines.index("endheader") + 1 :])
    assert lines[0] == "a_b" and head["nColumns"] == "5" and head["DataType"] == "double"
    assert names == ["time", "leg/a_b.x", "leg/a_b.x_2", "leg/a_b.x_3", "c.x"] and values == [
        "0.0",
        "0.0",
        "1.0",
        "2.0",
        "3.0",
    ]


def test_a_recording_without_angles_has_no_mot(command_line, tmp_path):
    record(plan(tmp_path, sink(CSV, "csv", columns("a.x m")), stem="other"), [row(0, 1.0)])
    assert "has no joint angle" in command_line.refused("convert", tmp_path / "other.mcap", "--to", "mot")


def test_no_file_is_written_if_a_format_cannot_hold_the_recording(command_line, tmp_path):
    record(plan(tmp_path, sink(CSV, "csv", columns("a.x m")), stem="other"), [row(0, 1.0)])
    command_line.refused("convert", tmp_path / "other.mcap", "--opensim", "-o", "opensim")
    command_line.refused("convert", tmp_path / "other.mcap", "--to", "csv,candump,parquet", "-o", "mixed")
    assert not (command_line.folder / "opensim").exists() and not (command_line.folder / "mixed").exists()


def test_recordings_after_one_that_cannot_be_converted_are_converted(command_line, tmp_path):
    for stem in ("a", "c", "e"):
        record(plan(tmp_path, sink(CSV, "csv", columns("a.x m")), stem=stem), [row(0, 1.0)])
    (tmp_path / "b.mcap").write_bytes(b"")
    (tmp_path / "d.mcap").write_text("a text")
    code, out, err = command_line("convert", *sorted(tmp_path.glob("*.mcap")), "--to", "csv", "-o", "tables")
    assert (code, out.split()) == (BAD_INPUT, [f"tables/{stem}.csv" for stem in "ace"])
    assert [line.split()[1] for line in err.splitlines()] == ["b.mcap", "d.mcap"]
    (tmp_path / "c.mcap").write_bytes((tmp_path / "c.mcap").read_bytes()[:-40])
    code, out, err = command_line("convert", *sorted(tmp_path.glob("*.mcap")), "--to", "mcap", "--in-place")
    assert code == BAD_INPUT and out.split() == [str(tmp_path / f"{stem}.mcap") for stem in "ace"]


@pytest.mark.parametrize("kind", ["csv", "parquet", "mat", "sto", "mcap"])
def test_a_file_gets_its_name_when_it_is_complete(recording, tmp_path, monkeypatch, kind):
    """The partial file of a killed conversion cannot be mistaken for the trial."""
    module = FORMATS.load(kind)
    if kind in ("parquet", "mat"):
        pytest.importorskip({"parquet": "pyarrow", "mat": "scipy"}[kind])
    write, found = module.write, []

    def watched(trial, path, progress):
        write(trial, path, progress)
        found.append([(tmp_path / f"odd.{kind}").stat().st_size, os.path.getsize(path) > 1000])

    monkeypatch.setattr(module, "write", watched)
    path = convert(runtime.load(recording), kind, str(tmp_path / "odd"))
    assert found == [[0, True]] and [str(file) for file in tmp_path.iterdir()] == [path]


def test_existing_files_are_not_overwritten(command_line, recording):
    first, second = (converted(command_line, recording, "csv") for _ in range(2))
    assert second.endswith("odd-2.csv") and open(first).read() == open(second).read()


@pytest.mark.parametrize(
    "words, made",
    [
        ("convert {} --to csv -o out", "out/odd.csv"),
        pytest.param("convert {} --to parquet,mat,sto,mot,mcap,rrd -o out", "out/odd.rrd", marks=pytest.mark.soak),
        pytest.param("plot {} on.y -o on.svg", "on.svg", marks=pytest.mark.soak),
        pytest.param("plot {} --strides --events on.y left/knee.torque -o on.svg", "", marks=pytest.mark.soak),
        pytest.param("diff {0} {0}", "", marks=pytest.mark.soak),
    ],
)
def test_commands_that_read_need_nothing_that_was_compiled(tmp_path, recording, words, made):
    rooms = copy_packages(tmp_path / "clone", built=False)
    process = python("-m", "runtime", *words.format(recording).split(), cwd=rooms)
    remarks = [
        line
        for line in process.stderr.splitlines()
        if not re.search(r"1 missed tick filled in|\d samples? with nan or inf filled in", line)
    ]
    assert remarks == [] or not made and "has no complete stride" in process.stderr, process.stderr
    assert not made or (rooms / made).stat().st_size > 1000


def test_run_commands_report_missing_build_with_remedy(tmp_path):
    rooms = copy_packages(tmp_path / "clone", built=False)
    assert_one_line(python("-m", "runtime", "check", "robot.py", cwd=rooms), "is not built")


def test_a_conversion_resamples_to_another_rate(command_line, recording):
    path = converted(command_line, recording, "csv", "--rate", "50")
    assert len(open(path).readlines()) == 1 + len(runtime.load(recording).resample(50))


@pytest.mark.parametrize(
    "kind, module, extra", [("parquet", "pyarrow", "parquet"), ("mat", "scipy", "matlab"), ("rrd", "rerun", "rerun")]
)
def test_missing_library_is_reported_with_its_extra(command_line, recording, monkeypatch, kind, module, extra):
    for name in [name for name in sys.modules if name.partition(".")[0] == module]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, module, None)
    assert f"needs {module}: pip install 'tickwork[{extra}]'" in command_line.refused(
        "convert", recording, "--to", kind
    )


def test_unreadable_or_unwritable_file_is_reported_in_one_line(command_line, recording, tmp_path):
    assert command_line.refused("convert", recording) == (
        "no format given: pass --to candump|csv|mat|mcap|sto|mot|parquet|rrd|xdf or --opensim"
    )
    assert command_line.refused("convert").startswith("no recording given: pass the .mcap file of a run")
    assert command_line.refused("convert", recording, "--to", " , ").startswith("no format given")
    assert (
        command_line("convert", recording, "--to", ".CSV,", "-o", tmp_path)[0] == OK and (tmp_path / "odd.csv").exists()
    )
    assert command_line.refused("convert", recording, "--to", "cvs") == (
        "--to cvs: there is no format 'cvs'; did you mean 'csv'?"
    )
    assert command_line.refused("convert", "nothing.mcap", "--to", "csv") == "nothing.mcap: No such file or directory"
    (tmp_path / "file").write_text("")
    code, out, err = command_line("convert", recording, "--to", "csv", "-o", tmp_path / "file")
    assert code == BAD_INPUT and "cannot write into file: it is a file" in err and len(err.splitlines()) == 1


@pytest.mark.parametrize(
    "kind, told", [("csv", "File too large"), pytest.param("rrd", ".*is the disk full\\?", marks=pytest.mark.soak)]
)
def test_full_disk_leaves_no_file_and_is_reported_in_one_line(recording, tmp_path, kind, told):
    """A file may not grow beyond 2000 bytes."""
    if kind == "rrd":
        pytest.importorskip("rerun")
    words = ("convert", recording, "--to", kind, "-o", "out")
    process = finished(*words, cwd=tmp_path, limits={"RLIMIT_FSIZE": 2000}, timeout=120)
    assert (process.returncode, process.stdout) == (BAD_INPUT, "") and list((tmp_path / "out").iterdir()) == []
    assert re.fullmatch(f"tickwork: cannot write out/odd.{kind}: {told}\n", process.stderr)


def test_a_whole_run_is_the_same_in_every_format(command_line, tmp_path):
    code, out, err = command_line(KNEE_EXO, "--fast", "--duration", "10", "--record", tmp_path / "run")
    assert code == OK, err
    [path] = (tmp_path / "run").glob("*.mcap")
    assert open(converted(command_line, path, "csv"), "rb").read() == path.with_suffix(".csv").read_bytes()
    told = json.loads(path.with_suffix(".json").read_text())["strides"][0]
    strides = runtime.load(path).strides("left/knee.position")
    assert len(strides) == told["strides"] >= 2
    # rad; over time here, over the phase there
    assert np.abs(strides.mean(axis=0) - told["curves"]["angle"]["mean"]).max() < 0.02


def test_file_that_is_not_a_recording_is_reported_with_remedy(command_line, recording):
    from mcap.writer import Writer

    folder = command_line.folder
    (folder / "none").mkdir()
    whole = recording.read_bytes()
    for name, content in (
        ("trial.mcap", whole),
        ("trial.csv", b"time [s],tick\n"),
        ("empty.mcap", b""),
        ("head.mcap", whole[:300]),
    ):
        (folder / name).write_bytes(content)
    with open(folder / "other.mcap", "wb") as file:
        writer = Writer(file)
        writer.start(library="rosbag2")
        writer.finish()
    for name, told in (
        ("trial.csv", "trial.csv is not a recording of Tickwork: pass trial.mcap"),
        ("empty.mcap", "empty.mcap was truncated before its first tick and contains no data"),
        ("head.mcap", "head.mcap was truncated before its first tick and contains no data"),
        ("other.mcap", "other.mcap is an MCAP file of another program (rosbag2): pass a recording of Tickwork"),
        ("trail.mcap", "trail.mcap: No such file or directory: did you mean trial.mcap?"),
        (".", ". is a folder: pass the recordings in it, as in *.mcap"),
        ("none", "the folder none contains no recording (.mcap)"),
    ):
        assert command_line.refused("convert", name, "--to", "csv") == told
    told = "-o knee.csv: expected a folder; the files in it have the name of the recording"
    assert command_line.refused("convert", "trial.mcap", "--to", "csv", "-o", "knee.csv") == told


def test_truncated_file_is_converted_up_to_the_cut_and_reported(command_line, recording):
    file, whole = command_line.folder / "torn.mcap", recording.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    code, out, err = command_line("convert", file, "--to", "csv")
    trial = runtime.load(file)
    assert (
        code == CHECK_FAILED
        and err.startswith(f"tickwork: torn.mcap is incomplete: it was truncated; {trial.unverified} of its ticks are ")
        and err.endswith(f"not verified by a checksum, {len(trial)} ticks until {trial.time[-1]:g} s\n")
    )
    assert 100 < len(trial) < 200 and not trial.complete
    assert (
        open(out.strip(), "rb").readlines()
        == recording.with_suffix(".csv").read_bytes().splitlines(keepends=True)[: 1 + len(trial)]
    )


@pytest.mark.parametrize("inserted, removed", [(b"", 5), (b"\xff" * 30, 0)])
def test_values_with_a_wrong_checksum_are_not_converted(command_line, recording, inserted, removed):
    file, whole = command_line.folder / "torn.mcap", recording.read_bytes()
    at = len(whole) // 2
    file.write_bytes(whole[:at] + inserted + whole[at + removed :])
    code, out, err = command_line("convert", file, "--to", "csv")
    assert code == CHECK_FAILED and err.startswith("tickwork: torn.mcap is damaged: of its ")
    assert len(runtime.load(file)) == 0 and err.endswith(", no ticks\n")


def test_xdf_is_read_by_pyxdf_and_a_file_of_the_laboratory_has_the_time_axis_of_the_trial(command_line, recording):
    load = pytest.importorskip("pyxdf").load_xdf
    path = converted(command_line, recording, "xdf")
    (signals, events), trial = load(path, dejitter_timestamps=False)[0], runtime.load(recording)
    assert bits(signals["time_stamps"]) == bits(trial.time)
    assert bits(np.ravel(signals["time_series"])) == bits(np.ravel(trial.rows))
    channels = signals["info"]["desc"][0]["channels"][0]["channel"]
    assert [(each["label"][0], each["unit"][0]) for each in channels] == [(n, trial.unit(n)) for n in trial.signals]
    assert events["time_series"][-1][0].startswith("end: ok")
    # a recorder whose clock is 5 s ahead and faster by 1 ‰, and a stream by that clock
    stamps = 5.0 + 1.001 * np.arange(0.0, 1.4, 0.1)
    with open(path, "ab") as file:
        for time in np.arange(0.0, 1.6, 0.2):
            xdf.put(file, 4, struct.pack("<Idd", 1, time, 5.0 + 0.001 * time))
        xdf.describe(file, 9, "EMG", "EMG", "double64", 10.0, [("biceps", "µV")], trial)
        sent = b"".join(b"\x08" + struct.pack("<dd", stamp, 7.0) for stamp in stamps)
        xdf.samples(file, 9, len(stamps), sent)
    streams = trial.xdf(path)
    emg = streams["EMG"]
    assert np.allclose(emg.time, np.arange(0.0, 1.4, 0.1), rtol=0.0, atol=1e-6)
    assert np.allclose(streams["bench"].time, trial.time, rtol=0.0, atol=1e-9)
    assert (emg.labels, emg.units, emg.kind, emg.values[3][0]) == (("biceps",), ("µV",), "EMG", 7.0)
    with pytest.raises(BadInput, match="is not an XDF file"):
        trial.xdf(recording)


def test_pyxdf_needs_no_warning_for_the_clock_of_an_exported_recording(command_line, recording, caplog):
    load = pytest.importorskip("pyxdf").load_xdf
    load(converted(command_line, recording, "xdf"))
    assert caplog.records == []


def test_streams_of_one_name_have_names_of_their_own_and_one_without_samples_is_empty(command_line, recording):
    pytest.importorskip("pyxdf")
    path, trial = converted(command_line, recording, "xdf"), runtime.load(recording)
    with open(path, "ab") as file:
        for stream, name, count in ((7, "EMG", 3), (8, "EMG", 2), (9, "force", 0)):
            xdf.describe(file, stream, name, "EMG", "double64", 10.0, [("biceps", "µV")], trial)
            xdf.samples(file, stream, count, b"".join(b"\x08" + struct.pack("<dd", k, stream) for k in range(count)))
    found = trial.xdf(path)
    assert {name: len(each.time) for name, each in found.items() if "bench" not in name} == {
        "EMG (tickwork EMG) 7": 3,
        "EMG (tickwork EMG) 8": 2,
        "force": 0,
    }
    assert found["EMG (tickwork EMG) 8"].values[1][0] == 8.0


def test_a_stream_that_labrecorder_continued_in_a_later_run_is_found_by_the_times_of_its_ticks(
    command_line, recording, tmp_path
):
    pytest.importorskip("pyxdf")
    path = converted(command_line, recording, "xdf")
    (tmp_path / "renamed.mcap").write_bytes(recording.read_bytes())
    trial = runtime.load(tmp_path / "renamed.mcap")
    with open(path, "ab") as file:  # the next run
        sample = b"\x08" + struct.pack("<d", 100.0025) + bytes(8 * trial.rows.shape[1])
        xdf.samples(file, 1, 1, sample)
    streams = trial.xdf(path)
    assert np.allclose(streams["bench"].time[:-1], trial.time, rtol=0.0, atol=1e-9)
    assert streams["bench"].time[-1] == pytest.approx(100.0025)
    other, shifted = xdf.start(trial) + 0.001 + trial.time, tmp_path / "shifted.xdf"
    with open(shifted, "wb") as file:
        file.write(b"XDF:")
        xdf.put(file, xdf.FILE_HEADER, b'<?xml version="1.0"?><info><version>1.0</version></info>')
        xdf.describe(file, 1, "bench", xdf.SIGNALS, "double64", 200.0, [("a", "1")], runtime.load(recording))
        xdf.samples(file, 1, len(other), b"".join(b"\x08" + struct.pack("<dd", stamp, 0.0) for stamp in other))
    with pytest.raises(BadInput, match="has no signals of the recording renamed: its streams are bench"):
        trial.xdf(shifted)


@pytest.mark.parametrize("length", [0, 3, 4, 60])
def test_an_xdf_file_that_is_cut_in_its_header_is_an_error_in_one_line(command_line, recording, length):
    pytest.importorskip("pyxdf")
    path = Path(converted(command_line, recording, "xdf"))
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(BadInput, match="is not an XDF file|its streams are no stream"):
        runtime.load(recording).xdf(path)


def test_candump_is_the_can_log_of_the_recorder(command_line):
    """Standard, extended, remote, error and CAN FD frames of two CAN buses; a serial stream is left out."""
    extended, remote, error, rate_switch, error_state, fd = 0x80000000, 0x40000000, 0x20000000, 1, 2, 4
    records = []
    for tick in range(300):
        time = 5_000_000 * tick
        records += [
            (4, time.to_bytes(8, "little", signed=True)),
            frame(time, tick, bytes(range(tick % 9)), bus=tick % 2),
            frame(time + 1499, extended | tick << 18, b"ab", bus=1, sent=1),
            frame(time + 2, remote | 5, b"", bus=0),
            frame(time + 3, error | 0x40, bytes(8), bus=1),
            frame(time + 4, 6, bytes(8), bus=1, flags=fd | rate_switch * (tick % 2) | error_state * (tick % 3 == 0)),
            frame(time + 5, extended | 7, bytes(range(8 + tick % 57)), bus=0, flags=fd),
            frame(time + 6, 8, b"text", bus=2),
            row(tick, 1.0),
        ]
    order = plan(
        command_line.folder,
        sink(CSV, "csv", columns("a.x m")),
        stem="all",
        buses=["0", "legs", "serial"],
        media=["can", "can", "stream"],
    )
    record(order, records)
    code, out, err = command_line("convert", "all.mcap", "--to", "candump")
    assert (code, err, out) == (OK, "", "all-2.can.log\n")
    text = (command_line.folder / "all-2.can.log").read_text()
    assert text == (command_line.folder / "all.can.log").read_text() and text.count("\n") == 300 * 6
    assert not list(command_line.folder.glob("*.part*"))


def test_candump_needs_a_can_bus(command_line, recording):
    message = command_line.refused("convert", recording, "--to", "candump", "-o", ".")
    assert message == f"{recording} has no CAN bus"


def test_parquet_keeps_every_bit_of_signals_with_few_and_with_many_values(command_line, tmp_path, monkeypatch):
    parquet = pytest.importorskip("pyarrow.parquet")
    monkeypatch.setattr("runtime.record.export.parquet.ROW_GROUP", 18_000)
    noise = np.random.default_rng(1).standard_normal(40_000)
    rows = [
        row(tick, value, round(value * 50) / 50, tick % 3, math.nan, math.nan if tick == 39_000 else tick)
        for tick, value in enumerate(noise)
    ]
    signals = columns("a.noise 1", "a.wire 1", "a.state 1 int", "a.lost 1 int", "a.lost_once 1 int")
    record(plan(tmp_path, sink(CSV, "csv", signals), stem="noise"), rows, shared=SharedState(1 << 23))
    path = converted(command_line, tmp_path / "noise.mcap", "parquet")
    table, trial = parquet.read_table(path), runtime.load(tmp_path / "noise.mcap")
    for name in trial.signals:
        assert bits(table[name].to_numpy()) == bits(trial[name]) and table[name].to_numpy().dtype == trial[name].dtype
    assert parquet.ParquetFile(path).metadata.num_row_groups == 3
    metadata = parquet.ParquetFile(path).metadata.row_group(0)
    encodings = {metadata.column(index).path_in_schema: metadata.column(index).encodings for index in range(7)}
    assert "BYTE_STREAM_SPLIT" in encodings["a.noise"] and "RLE_DICTIONARY" in encodings["a.wire"]
    assert os.path.getsize(path) < 8 * len(noise) * 1.3
