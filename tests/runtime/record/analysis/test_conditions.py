"""Conditions over the gait cycle: which strides count, their figures, the table and the picture."""

import dataclasses
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

import runtime
from cext.memory.shared_state import RECORD_EVENT
from runtime.host.errors import OK, BadInput
from runtime.record.analysis import condition_table
from runtime.record.analysis.conditions import Condition, conditions
from tests.runtime.record.analysis.test_plots import drawn
from tests.runtime.record.recorder.running import CSV, columns, plan, record, row, sink

SIGNALS = (
    "left/gait.phase 1",
    "left/gait.walking 1 bool",
    "left/knee.position rad",
    "left/knee.velocity rad/s",
    "left/knee.torque N·m",
)
RATE, STRIDE, STRIDES = 200, 200, 10  # Hz; ticks; a recording
MARKS = (800, 1400)  # ticks


def recorded(folder, stem, torque, fields=None):
    """A leg that walks strides of 1 s with θ = sin φ and ω = cos φ. torque : function of (stride, φ)

    By τ = g cos φ the work a stride is +g/2·(1 s), all of it positive.
    """
    rows = []
    for tick in range(STRIDES * STRIDE):
        stride, within = divmod(tick, STRIDE)
        angle = 2.0 * math.pi * within / STRIDE
        rows.append((tick, within / STRIDE, 1, math.sin(angle), math.cos(angle), torque(stride, angle)))
    records = [row(*values) for values in rows]
    for number, tick in enumerate(MARKS, 1):
        event = f'{{"event": "mark", "tick": {tick}, "number": {number}}}'
        records.insert(tick + number, (RECORD_EVENT, event.encode()))
    order = plan(folder, sink(CSV, "csv", columns(*SIGNALS)), stem=stem, metadata={"trial": fields or {}})
    record(order, records)
    return folder / f"{stem}.mcap"


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Recordings of gains 5 and 4 that alternate by ± 0.1 from stride to stride."""
    folder = tmp_path_factory.mktemp("pair")
    return [
        recorded(
            folder,
            stem,
            lambda stride, angle, gain=gain: (gain + 0.1 * (-1) ** stride) * math.cos(angle),
            {"condition": stem, "mass": "50"},
        )
        for stem, gain in (("off", 5.0), ("on", 4.0))
    ]


@pytest.mark.parametrize(
    ("between", "last", "strides"),
    [
        (None, None, 8),  # the first stride has no begin, the last no end
        (None, 3, 3),
        (("start", "mark 1"), None, 3),
        (("mark 1", "mark 2"), None, 2),
        (("mark 1", "end"), 2, 2),
        ((4.5, 7.5), None, 2),
    ],
)
def test_strides_are_selected_by_time_and_number(pair, between, last, strides):
    trial = runtime.load(pair[0])
    assert len(trial.strides("left/knee.torque", between=between, last=last)) in (strides, strides + 1)
    [leg] = Condition("", trial, None, between, last).legs().values()
    assert len(leg.strides) == strides
    times = trial.stride_times("left/knee.torque", between=between, last=last)
    low, high = (0.0, 10.0) if between is None else (4.5, 7.5) if between[0] == 4.5 else (0.0, 10.0)
    assert np.all(times[:, 0] >= low) and np.all(times[:, 1] <= high) and np.allclose(np.diff(times), 1.0, atol=0.006)


def test_last_strides_are_those_at_the_end(pair):
    trial = runtime.load(pair[0])
    assert np.array_equal(trial.strides("left/knee.torque", last=2), trial.strides("left/knee.torque")[-2:])
    assert len(trial.strides("left/knee.torque", last=99)) == len(trial.strides("left/knee.torque"))


def test_figures_are_those_of_the_closed_form_and_scale_with_body_mass(pair):
    first, second = conditions([runtime.load(path) for path in pair])
    assert (first.label, second.label) == ("off", "on")
    [(counts, figures, signals)] = condition_table.compare(first, second).values()
    row = {one.name: one for one in figures}
    assert counts == (8, 8)
    assert row["positive work"].first[0] == pytest.approx(2.5, rel=2e-3)
    assert row["positive work"].first[1] == pytest.approx(0.05 * math.sqrt(8 / 7), rel=2e-2)
    assert row["positive work"].relative == pytest.approx(-0.2, rel=1e-3)
    assert condition_table.percent(row["positive work"]) == "−20 %"
    assert condition_table.percent(dataclasses.replace(row["positive work"], relative=-12.0)) == ""
    assert row["positive work"].effect == pytest.approx(0.5 / (0.05 * math.sqrt(8 / 7)), rel=2e-2)
    assert row["stride time"].effect == row["angle, range"].effect == 0.0
    assert {one.name for one in figures[:2]} <= {"positive work", "torque, peak", "power, peak"}
    assert [one.name for one in signals] == ["knee.torque", "knee.position", "knee.velocity"]
    assert abs(signals[0].largest) == pytest.approx(1.0, rel=1e-3) and signals[0].at in (0.0, 50.0, 100.0)
    [light, _] = conditions([runtime.load(path) for path in pair], per_kg="mass")
    [leg], [whole] = light.legs().values(), first.legs().values()
    assert leg.strides[0].positive_work == pytest.approx(whole.strides[0].positive_work / 50.0)
    assert np.allclose(leg.curves("torque"), whole.curves("torque") / 50.0)
    assert np.array_equal(leg.curves("angle"), whole.curves("angle"))


@pytest.mark.soak
def test_diff_of_strides_prints_the_clearest_difference_first(command_line, pair):
    code, out, err = command_line("diff", *pair, "--strides", "--per-kg", "-o", "diff.svg")
    assert (code, err) == (OK, "")
    lines = out.splitlines()
    assert lines[:2] == ["A  off", "B  on"] and lines[3] == "left: 8 strides in A, 8 in B"
    table = {" ".join(line.split()[:3]): line for line in lines[6:12]}
    assert "−20 %" in table["positive work [J/kg]"] and table["stride time [s]"].split()[-1] == "0.0"
    assert lines[-1] == "diff.svg"
    named = {"off, N = 8 strides", "on, N = 8 strides", "knee angle (°)", "knee torque (N·m/kg)", "gait cycle (%)"}
    assert named <= drawn("diff.svg")


@pytest.mark.soak
def test_sections_of_one_recording_are_conditions(command_line, pair):
    sections = ("--between", "start", "mark 1", "--between", "mark 2", "9.5")
    code, out, err = command_line("plot", pair[0], "--strides", *sections, "-o", "sections.svg")
    assert (code, out, err) == (OK, "sections.svg\n", "")
    assert {"start to mark 1, N = 3 strides", "mark 2 to 9.5 s, N = 1 stride"} <= drawn("sections.svg")
    code, out, err = command_line("diff", pair[0], pair[0], "--strides", *sections)
    assert code == OK and out.startswith("A  start to mark 1\nB  mark 2 to 9.5 s\n")


def test_rounding_of_a_mean_is_no_difference():
    strides = np.full(3, 1.1)
    assert condition_table.figure("stride time", "s", strides, strides + 3e-16).largest == 0.0
    assert condition_table.figure("stride time", "s", strides, strides + 1e-6).largest > 0.0


def test_signals_of_several_recordings_share_a_plot(command_line, pair):
    folders = []
    for path in pair:
        folders.append(Path(path.stem))
        folders[-1].mkdir()
        shutil.copy(path, folders[-1])
    code, out, err = command_line("plot", *folders, "left/knee.torque", "--strides", "--last", 4, "-o", "signals.svg")
    assert (code, out, err) == (OK, "signals.svg\n", "")
    assert {"knee torque, left (N·m)", "off, N = 4 strides", "on, N = 4 strides"} <= drawn("signals.svg")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("plot", "OFF", "--last", 3), "--last needs --strides"),
        (("diff", "OFF", "ON", "--per-kg", "70"), "--per-kg needs --strides"),
        (("plot", "OFF", "--strides", "--last", 0), "--last 0: expected a whole number, 1 or more"),
        (("plot", "OFF", "--strides", "--per-kg", "-3"), "--per-kg needs a body mass in kg above 0, as in --per-kg 72"),
        (
            ("plot", "OFF", "--strides", "--between", "mark 7", "end"),
            "'mark 7' is not a time: expected seconds, start, end or a mark; the recording has mark 1, mark 2",
        ),
        (
            ("plot", "OFF", "--strides", "--between", "end", "mark 1"),
            "between end and mark 1: 9.995 s is not before 4 s",
        ),
        (
            ("diff", "OFF", "OFF", "--strides"),
            "diff --strides compares 2 conditions, not 1: pass two recordings, or one recording twice "
            "with two --between",
        ),
    ],
)
def test_wrong_options_are_refused_with_the_remedy(command_line, pair, arguments, message):
    known = {"OFF": pair[0], "ON": pair[1]}
    assert command_line.refused(*(known.get(word, word) for word in arguments)) == message


def test_missing_body_mass_is_reported_with_the_option(tmp_path):
    path = recorded(tmp_path, "bare", lambda stride, angle: math.cos(angle))
    with pytest.raises(BadInput, match="the recording has no field mass: pass the body mass, as in --per-kg 72"):
        conditions([runtime.load(path)], per_kg="mass")
