"""`set PID`: another process changes live parameters of a run, or receives the reason for a refusal."""

import gc
import os
import signal
import subprocess
from contextlib import contextmanager

import numpy as np
import pytest

from cext.memory.shared_state import SharedState
from cext.schedule.mailbox_writer import Writer
from runtime.host.live.running import runs, shared_state_of
from tests.runtime.runs import Files, finished, knee, started, write
from tests.runtime.terminals import live_diagram, patient


@contextmanager
def going(folder, *words):
    """A run in real time that goes on: its Popen."""
    process = started(*words, cwd=folder)
    try:
        shared = patient(lambda: shared_state_of(process.pid))
        patient(lambda: shared.statistics()["ticks"] > 0)
        yield process
    finally:
        if process.poll() is None:
            process.kill()
            process.communicate()


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run that none of these tests changes."""
    folder = tmp_path_factory.mktemp("run")
    live_diagram(folder)
    with going(folder, "springs.py", "--no-record") as process:
        yield process


def test_set_without_settings_lists_values_bounds_and_units(run, command_line, golden):
    code, out, err = command_line("set", run.pid)
    assert (code, err) == (0, "")
    assert out.startswith(f"springs (process {run.pid}, running, tick ")
    golden("set", out, process=rf"\b{run.pid}\b", tick=r"(?<=tick )\d+", seconds=r"(?<=\()[\d.]+ s")


REFUSED = {
    "spring.stiffness=151": "spring.stiffness=151: must be at most 150.0 N·m/rad, got 151.0",
    "wave.angle=-90 deg": "wave.angle=-90 deg: must be at least -1.0 rad, got -1.5707963267948966",
    "spring.stiffness=nan": "spring.stiffness=nan: NaN is not allowed",
    "spring.stiffness=inf": "spring.stiffness=inf: must be at most 150.0 N·m/rad, got inf",
    "spring.stiffness=stiff": "spring.stiffness=stiff: 'stiff' is not a number",
    "wave.angle=1 N": "wave.angle=1 N: N does not convert to rad",
    "wave.count=2.5": "wave.count=2.5: expected a whole number, got 2.5",
    "wave.on=perhaps": "wave.on=perhaps: expected true or false, got 'perhaps'",
    "spring.stifness=40": "spring.stifness=40: springs has no live parameter 'spring.stifness'; did you mean "
    "'spring.stiffness'?",
    "zzz=1": "zzz=1: springs has no live parameter 'zzz'; the live parameters are spring.stiffness, "
    "spring.damping, wave.angle, wave.count, wave.on",
    "wave.on": "wave.on: expected NAME=VALUE, as in left/impedance.stiffness=40",
    "--stop": "--stop and PATH=VALUE exclude each other: the run ends",
}


@pytest.mark.parametrize("setting", REFUSED)
def test_invalid_change_is_reported_and_not_applied(run, command_line, setting):
    assert command_line.refused("set", run.pid, "spring.damping=9", setting) == REFUSED[setting]
    assert shared_state_of(run.pid).live_values()[1] == (1.0, 1.0)


def test_change_of_fixed_parameter_lists_live_ones(run, command_line):
    said = command_line.refused("set", run.pid, "wave.shape=1")
    assert said.startswith("wave.shape=1: springs has no live parameter 'wave.shape'; ")


def test_process_that_is_not_a_run_lists_running_ones(run, command_line):
    with subprocess.Popen(["sleep", "60"]) as stranger:
        for pid, trouble in ((stranger.pid, "is not a run of a diagram"), (2**22 + 1, "does not exist")):
            said = command_line.refused("set", pid, "spring.damping=9")
            assert said.startswith(f"process {pid} {trouble}; runs are ") and f"{run.pid} (springs)" in said
        assert run.pid in runs() and stranger.pid not in runs()
        stranger.kill()
    gc.unfreeze()  # see tests/conftest.py
    gc.collect()  # shared states of earlier tests of this process
    for text in (b"{}", b"[1]", b"\0", b"null"):
        shared = SharedState(4096, live=(1, text))
        said = command_line.refused("set", 2**22 + 1)
        assert f"{os.getpid()} (its table of parameters is damaged)" in said and f"{run.pid} (springs)" in said
        del shared
    assert command_line.refused("set", "me").startswith("set me: expected the process number of a run, as in ")


def test_emulate_is_not_listed_as_a_run(tmp_path, command_line):
    channel = f"239.{10 + os.getpid() % 200}.{os.getpid() // 200 % 250}.78"
    rig = write(tmp_path, f'[bus.legs]\ninterface = "udp_multicast"\nchannel = "{channel}"\n', "lab.toml")
    with going(tmp_path, "emulate", knee(tmp_path), "--rig", rig) as process:
        assert process.pid not in runs()
        assert f"process {process.pid} is not a run of a diagram" in command_line.refused("set", process.pid)


def test_change_is_applied_and_recorded_at_reported_tick(tmp_path, command_line):
    """Of several settings all or none; with units; from a file; and each in the recording, by the process that set
    it.
    """
    live_diagram(tmp_path)
    (tmp_path / "gentle.set").write_text("# gentle\n\n#\nspring.damping = 2.5\n")
    told = []
    with going(tmp_path, "springs.py") as run:
        for words in (
            ["spring.stiffness=40", "wave.angle=60 deg", "wave.count=5"],
            ["wave.on=no"],
            ["@gentle.set"],
            ["wave.on=yes"],
        ):
            process = finished("set", run.pid, *words, cwd=tmp_path)
            assert (process.returncode, process.stderr) == (0, ""), process
            told += process.stdout.splitlines()
        run.send_signal(signal.SIGINT)
        assert "6 changes of live parameters, 0 marks" in run.communicate(timeout=30)[0] and run.returncode == 130
        assert command_line.refused("set", run.pid, "spring.damping=2").startswith(
            f"process {run.pid} does not exist; "
        )
    files = Files(tmp_path / "recordings")
    events, table = files.sidecar["events"], files.table
    first, off, damping, on = (events[index]["tick"] for index in (0, 3, 4, 5))
    assert told == [
        f"spring.stiffness: 30 N·m/rad to 40 N·m/rad from tick {first} on, over 0.05 s",
        f"wave.angle: 0.5 rad to 1.0472 rad from tick {first} on",
        f"wave.count: 3 to 5 from tick {first} on",
        f"wave.on: true to false from tick {off} on",
        f"spring.damping: 1 N·m·s/rad to 2.5 N·m·s/rad from tick {damping} on, over 0.15 s",
        f"wave.on: false to true from tick {on} on",
    ]
    assert [event["tick"] for event in events[:3]] == [first] * 3 and first < off < damping < on
    assert all(
        event["event"] == "set" and event["by"].startswith("set ") and int(event["by"][4:]) != run.pid
        for event in events
    )
    assert events[1]["value"] == np.deg2rad(60) and events[1]["from"] == 0.5
    row = {int(tick): index for index, tick in enumerate(table["tick"])}
    wave, torque = table["wave.y"], table["spring.torque [N*m]"]
    assert wave[row[first] - 1] == 1030.5 and wave[row[first]] == 1050.0 + np.deg2rad(60)
    assert wave[row[off] - 1] > 1000.0 and wave[row[off]] < 100.0 < 1000.0 < wave[row[on]]
    assert torque[row[first] - 1] == -30.0 and torque[row[first] + 10] == -40.0
    ticks = table["tick"][row[first]] - table["tick"][row[first] - 1]  # more than one where some were missed
    np.testing.assert_allclose(torque[row[first]], -30.0 - 200.0 / 200.0 * ticks, rtol=0, atol=1e-9)

    code, out, err = command_line("replay", files.one(".mcap"))
    assert (code, err) == (0, "") and "the same, bit for bit" in out, (
        "what was changed is changed again, in the same ticks"
    )
    write(tmp_path, live_diagram(tmp_path).read_text().replace("max=150.0, slew", "max=35.0, slew"), "narrow.py")
    said = command_line.refused("replay", files.one(".mcap"), "--diagram", "narrow.py")
    assert said.endswith(
        f"spring.stiffness was set to 40.0 at tick {first}, but its live range in the diagram is 0 to 35"
    )


def test_set_stops_a_run_whose_mailbox_is_full(tmp_path):
    live_diagram(tmp_path)
    with going(tmp_path, "springs.py") as run:
        writer = Writer(shared_state_of(run.pid))
        while writer.set([(1, 5.0)]) is not None:
            pass  # its answers are not read
        process = finished("set", run.pid, "--stop", cwd=tmp_path)
        assert process.returncode == 0 and process.stdout.startswith(
            f"springs (process {run.pid}) was stopped after tick "
        )
        assert "stopped by process " in run.communicate(timeout=30)[1] and run.returncode == 0
    [stop] = [event for event in Files(tmp_path / "recordings").sidecar["events"] if event["event"] == "stop"]
    assert stop["by"].startswith("set ") and int(stop["by"][4:]) != os.getpid() and stop["tick"] > 0


def test_stopped_process_drops_change(tmp_path, command_line, monkeypatch):
    monkeypatch.setattr("runtime.host.live.sending.TAKE_TIMEOUT", 0.2)
    live_diagram(tmp_path)
    with going(tmp_path, "springs.py", "--no-record") as process:
        shared = shared_state_of(process.pid)
        process.send_signal(signal.SIGSTOP)
        said = command_line.refused("set", process.pid, "spring.damping=2")
        assert said.startswith(f"process {process.pid}: it did not apply the change within 0.2 s") and said.endswith(
            "nothing was changed"
        )
        process.send_signal(signal.SIGCONT)
        ticks = shared.statistics()["ticks"]
        patient(lambda: shared.statistics()["ticks"] > ticks + 20)
        assert shared.live_values()[1] == (1.0, 1.0)


def test_diagram_without_live_parameters_is_reported(tmp_path, command_line):
    lines = (
        "from blocks.sources import Sine",
        "from graph import Diagram",
        "",
        ("with Diagram('plain', rate=100) as diagram:"),
        "    Sine()",
    )
    write(tmp_path, "\n".join(lines) + "\n", "plain.py")
    with going(tmp_path, "plain.py", "--no-record") as process:
        assert command_line.refused("set", process.pid).startswith(
            f"plain (process {process.pid}) has no live parameters: "
        )


def test_settings_from_a_file_are_those_of_the_command_line(tmp_path, command_line):
    live_diagram(tmp_path)
    (tmp_path / "ours.set").write_text("# a remark\nspring.stiffness=45.5\n\n  wave.on = false\n")
    code, out, err = command_line("check", "springs.py", "--set", "@ours.set", "--set", "wave.count=7", "--json")
    assert code == 0 and err == "", err
    said = command_line.refused("check", "springs.py", "--set", "@none.set")
    assert said == "--set @none.set: cannot read the file: No such file or directory"
    (tmp_path / "ours.set").write_text("# a remark\nspring.stiffness\n")
    said = command_line.refused("check", "springs.py", "--set", "@ours.set")
    assert said.startswith("ours.set:2: spring.stiffness: expected NAME=VALUE, as in ")
    (tmp_path / "ours.set").write_text("spring.stiffness=400\n")
    assert "must be" in command_line.refused("check", "springs.py", "--set", "@ours.set")
