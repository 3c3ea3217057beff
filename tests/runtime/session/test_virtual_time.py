"""Runs in virtual time: which processes they start, and what they send."""

import re

import pytest

import runtime.session.session as session
from runtime.host.errors import OK
from tests.runtime.runs import KNEE_EXO, Listener, write

STRIDES = re.compile(r"^  (left|right) .*$\n.*$", re.MULTILINE)


@pytest.fixture
def no_process(monkeypatch):
    """Make the start of a recorder process an error."""

    def refuse(shared):
        raise AssertionError("a recorder process was started")

    monkeypatch.setattr(session, "RecorderProcess", refuse)


def figures(text):
    return [match[0] for match in STRIDES.finditer(text)]


def test_run_without_files_starts_no_recorder_and_has_the_same_strides(command_line, monkeypatch):
    code, recorded, _ = command_line(KNEE_EXO, "--fast", "--duration", "12")
    assert code == OK and (command_line.folder / "recordings").exists()
    monkeypatch.setattr(session, "RecorderProcess", lambda shared: pytest.fail("a recorder process was started"))
    code, out, err = command_line(KNEE_EXO, "--fast", "--duration", "12", "--no-record")
    assert (code, err) == (OK, "") and "2400 of 2400 done" in out and "0 records dropped" in out
    assert len(figures(out)) == 2 and figures(out) == figures(recorded)


def test_diagram_without_recorder_starts_no_process(command_line, tmp_path, no_process):
    path = write(
        tmp_path,
        """
from blocks.sources import Sine
from graph import Diagram

with Diagram("quiet", rate=200) as diagram:
    Sine()
""",
    )
    code, out, _ = command_line(path, "--fast", "--duration", "30")
    assert code == OK and "6000 of 6000 done" in out


def test_ring_smaller_than_the_run_loses_no_row(command_line, monkeypatch, no_process):
    words = (KNEE_EXO, "--fast", "--duration", "12", "--no-record")
    expected = figures(command_line(*words)[1])
    monkeypatch.setattr(session, "ring_bytes", lambda schedule: 1 << 14)
    code, out, _ = command_line(*words)
    assert code == OK and "0 records dropped" in out and figures(out) == expected


def test_error_of_the_local_recorder_ends_the_run(command_line, monkeypatch):
    from runtime.record.recorder import local

    def fail(shared, columns):
        raise RuntimeError("no more rows")

    monkeypatch.setattr(local, "take", fail)
    with pytest.raises(RuntimeError, match="no more rows"):
        command_line(KNEE_EXO, "--fast", "--duration", "12", "--no-record")


@pytest.mark.parametrize(
    "words, sends",
    [((), False), (("--plotjuggler", "ADDRESS"), True), (("--set", "plot_juggler.virtual_time=true"), True)],
)
def test_plotjuggler_receives_virtual_time_only_on_request(command_line, words, sends):
    with Listener() as listener:
        port = listener.address.rpartition(":")[2]
        words = [word.replace("ADDRESS", listener.address) for word in words]
        code, out, _ = command_line(
            KNEE_EXO, "--fast", "--duration", "1", "--no-record", "--set", f"plot_juggler.port={port}", *words
        )
        assert code == OK and bool(listener.rest()) is sends
    assert ("watch live in PlotJuggler" in out) is sends
