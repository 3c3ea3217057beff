"""Sleep of the computer: whether it can be suspended, and the inhibitor of a run."""

import os
import time

import pytest

from runtime.host.machine.probe import Machine
from runtime.host.machine.sleep import TARGETS, SleepInhibitor, can_sleep
from tests.forking import exit_code, fork

HELD = """#!/bin/sh
echo "$@" > {folder}/arguments
while [ "${{1#--}}" != "$1" ]; do shift; done
"$@"
echo over > {folder}/over
"""
REFUSED = """#!/bin/sh
echo "Failed to inhibit: Access denied" >&2
exit 1
"""


@pytest.fixture
def machine(tmp_path):
    """A machine that can be suspended."""
    (tmp_path / "sys/power").mkdir(parents=True)
    (tmp_path / "sys/power/state").write_text("freeze mem disk\n")
    return Machine(tmp_path)


def command(folder, monkeypatch, text):
    """Put a systemd-inhibit in front of the path."""
    path = folder / "systemd-inhibit"
    path.write_text(text.format(folder=folder))
    path.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")


def test_a_kernel_without_sleep_states_or_masked_targets_cannot_sleep(tmp_path, machine):
    assert can_sleep(machine) and not can_sleep(Machine(tmp_path / "other"))
    units = tmp_path / "etc/systemd/system"
    units.mkdir(parents=True)
    for name in TARGETS:
        assert can_sleep(machine)
        (units / f"{name}.target").symlink_to("/dev/null")
    assert not can_sleep(machine)
    (tmp_path / "sys/power/state").write_text("")
    assert not can_sleep(machine)


@pytest.mark.hazard("H4f")
def test_an_inhibitor_is_held_until_it_is_released(tmp_path, machine, monkeypatch):
    command(tmp_path, monkeypatch, HELD)
    inhibitor = SleepInhibitor("a robot is armed", machine)
    assert inhibitor.problem() == "" and inhibitor.remarks() == []
    words = (tmp_path / "arguments").read_text()
    assert "--mode=block" in words and "sleep" in words and "handle-lid-switch" in words
    assert "--why=a robot is armed" in words and not (tmp_path / "over").exists()
    inhibitor.release()
    inhibitor.release()


def test_an_inhibitor_ends_with_the_process_that_holds_it(tmp_path, machine, monkeypatch):
    command(tmp_path, monkeypatch, HELD)
    assert exit_code(fork(lambda: SleepInhibitor("a robot is armed", machine).problem() != "")) == 0
    deadline = time.monotonic() + 5.0
    while not (tmp_path / "over").exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert (tmp_path / "over").exists()


@pytest.mark.hazard("H4f")
def test_a_refused_inhibitor_is_reported_with_its_reason(tmp_path, machine, monkeypatch):
    command(tmp_path, monkeypatch, REFUSED)
    inhibitor = SleepInhibitor("a robot is armed", machine)
    assert inhibitor.problem() == "systemd-inhibit: Failed to inhibit: Access denied"
    [line] = inhibitor.remarks()
    assert line.startswith("caution: this computer can be suspended during the run (systemd-inhibit: Failed to inhibit")
    assert "systemctl mask sleep.target" in line


def test_a_missing_inhibitor_is_reported(tmp_path, machine, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert SleepInhibitor("a robot is armed", machine).problem() == "systemd-inhibit: No such file or directory"


def test_nothing_is_inhibited_where_the_computer_cannot_sleep(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert SleepInhibitor("a robot is armed", Machine(tmp_path)).remarks() == []
