"""Recordings of format 1, as Tickwork 0.1.0 wrote them: they open, replay and convert.

format1.zip has 20 ticks of diagrams/knee_exo.py: whole, cut off in its 15th row, and in two parts, as a recorder that
was killed and the next one left them.
"""

import zipfile
from pathlib import Path

import numpy as np
import pytest

import runtime
from runtime.host.errors import CHECK_FAILED, OK
from runtime.record.storage.batches import FRAME

ARCHIVE = Path(__file__).with_name("format1.zip")
TICKS = {"whole": 20, "cut": 14, "parts": 20}
FRAMES = {"whole": 96, "cut": 66, "parts": 96}
UNVERIFIED = {"whole": 0, "cut": 14, "parts": 11}  # an open chunk has no checksum in format 1


@pytest.fixture
def folder(command_line):
    with zipfile.ZipFile(ARCHIVE) as archive:
        archive.extractall(command_line.folder)
    return command_line.folder


@pytest.mark.parametrize("name", TICKS)
def test_recording_of_format_1_opens(folder, name):
    trial, whole = runtime.load(folder / f"{name}.mcap"), runtime.load(folder / "whole.mcap")
    assert trial.about["format"] == "1" and trial.fields == {"subject": "S01"} and trial.about["rate"] == 200.0
    assert trial.tick.tolist() == list(range(TICKS[name])) and len(trial.signals) == 36
    assert trial.complete == (name == "whole") and trial["left/knee.torque"].shape == (TICKS[name],)
    assert trial.unverified == UNVERIFIED[name]
    assert trial.rows.tobytes() == whole.rows[: len(trial)].tobytes()
    assert trial.frames == whole.frames[: FRAMES[name]] and len(trial.frames) == FRAMES[name]
    assert [path.stem for path in trial.parts] == (["parts", "parts_part2"] if name == "parts" else [name])


@pytest.mark.parametrize("name", TICKS)
def test_batches_hold_every_row_and_frame_in_order(folder, name):
    trial = runtime.load(folder / f"{name}.mcap")
    batches = list(trial.batches())
    rows, frames = (np.concatenate(arrays) for arrays in zip(*batches))
    assert frames.dtype == FRAME and all(len(rows) for rows, _ in batches[:-1]) and len(batches[-1].rows) == 0
    assert np.array_equal(rows, np.column_stack((trial.tick, trial.lateness, trial.rows)))
    assert [
        (*frame[:4], trial.about["buses"][bus], bool(sent), bytes(payload))
        for frame, bus, sent, payload in zip(
            frames[["drain", "drained", "row", "time"]].tolist(),
            frames["bus"],
            frames["sent"],
            frames.view("u1").reshape(-1, FRAME.itemsize)[:, 24:],
        )
    ] == [
        (frame.drain, frame.drained, frame.row, frame.time, frame.bus, frame.sent, frame.payload)
        for frame in trial.frames
    ]
    done = 0
    for number, (rows, frames) in enumerate(batches):
        last = number == len(batches) - 1
        assert np.all((frames["row"] >= done) & ((frames["row"] < done + len(rows)) | last))
        done += len(rows)


@pytest.mark.parametrize("name", TICKS)
def test_recording_of_format_1_replays_bit_for_bit(folder, command_line, name):
    code, out, _ = command_line("replay", f"{name}.mcap")
    assert code == OK and f"{TICKS[name]} ticks of {name}.mcap replayed" in out and "the same, bit for bit" in out


@pytest.mark.parametrize("name", TICKS)
def test_recording_of_format_1_converts(folder, command_line, name):
    before = runtime.load(folder / f"{name}.mcap")
    code, out, _ = command_line("convert", f"{name}.mcap", "--to", "mcap,csv", "-o", "out")
    assert code == (OK if name == "whole" else CHECK_FAILED)
    mcap, csv = (folder / line for line in out.splitlines())
    copy = runtime.load(mcap)
    assert copy.rows.tobytes() == before.rows.tobytes() and copy.frames == before.frames and len(copy.parts) == 1
    assert len(csv.read_text().splitlines()) == 1 + TICKS[name]
