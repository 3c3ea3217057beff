"""How the clock is to be kept, in the words of the command line, and the profile of a run: table, bars and picture."""

import json
import re
import struct

import pytest

from runtime.cli.run import parse_run
from runtime.record.report.profile import short
from tests.runtime.runs import DISABLE, KNEE_EXO, Files, assert_safely_stopped, knee


@pytest.mark.parametrize(
    "text, seconds", [("50us", 50e-6), ("50 µs", 50e-6), ("0.1ms", 1e-4), ("0s", 0.0), ("250ns", 250e-9)]
)
def test_a_window_to_spin_in_has_a_unit(text, seconds):
    assert parse_run(["robot.py", "--spin", text]).spin == pytest.approx(seconds, rel=1e-12)


@pytest.mark.parametrize(
    "text, complaint",
    [
        ("50", "expected a duration with its unit, as in 50us or 0.1ms"),
        ("-1us", "expected a duration"),
        ("2s", "maximum is 1 s"),
        ("us", "expected a duration"),
    ],
)
def test_a_window_without_one_is_refused(command_line, text, complaint):
    assert complaint in command_line.refused(KNEE_EXO, f"--spin={text}")


def test_an_unknown_overrun_policy_is_rejected_with_the_known_ones(command_line):
    assert command_line.refused(KNEE_EXO, "--overrun", "catchup:3") == (
        "--overrun catchup:3: unknown overrun policy 'catchup:3': expected skip, catch-up:N, fault:N or "
        "fault:N/WINDOW, "
        "with numbers from 1 to 1000000"
    )
    assert parse_run(["robot.py", "--overrun", "catch-up:2,fault:5/100"]).overrun == "catch-up:2,fault:5/100"


# Holds tick 20, or the first one after it that a late loop does not skip.
HOLD = """import time
        if tick >= 20 and not getattr(self, "held", 0):
            begun, self.held = time.monotonic(), tick
            time.sleep({seconds})
            open("held", "w").write(str(time.monotonic() - begun))
        return 0.5"""


def test_overrun_report_names_slowest_blocks(command_line):
    law = HOLD.format(seconds=0.04)
    code, out, err = command_line(knee(command_line.folder, law), "--duration", "0.3", "--record", "here")
    [line] = [line for line in out.splitlines() if " lost to law" in line]
    assert code == 0 and err == "" and re.search(r"\(tick [2-5]\d\)", line) and " ms max " in line
    [sidecar] = (command_line.folder / "here").glob("*.json")
    assert "law" in {row["name"] for row in json.loads(sidecar.read_text())["end"]["overruns"]}


def test_a_fault_by_overrun_names_the_block_and_the_policy(command_line):
    law = HOLD.format(seconds=0.3)  # longer than a busy machine holds a tick
    code, out, err = command_line(
        knee(command_line.folder, law), "--duration", "1", "--no-record", "--overrun", "fault:50"
    )
    first = err.splitlines()[0]
    assert code == 3 and re.fullmatch(
        r"FAULT at law, tick (\d+) \(0\.[1-4]\d* s\): it took [345]\d\d(\.\d)? ms \(tick \1\); \d+ grid points were "
        r"missed in total, more than --overrun fault:50 allows",
        first,
    ), first
    assert "safe stop   zero torque, then disable: confirmed by knee" in out


@pytest.mark.timing
def test_stop_frames_are_logged_within_two_ticks_of_overrun_fault(command_line):
    law = HOLD.format(seconds=0.11)  # at 50 Hz, five periods and a half
    code, *_ = command_line(
        knee(command_line.folder, law), "--rate", "50", "--duration", "2", "--record", "here", "--overrun", "fault:4"
    )
    files = Files(command_line.folder / "here")
    ticks = len(files.table["tick"])
    assert code == 3 and files.table["tick"][-1] >= 20
    assert_safely_stopped(files, [1])
    ours = [(time, data) for time, _, identifier, data, sent in files.frames if sent and identifier == 1]
    stop = next(index for index, (_, data) in enumerate(ours) if data == DISABLE) - 1
    late = ours[stop][0] - ours[stop - 1][0]  # from the last command, which bears the time of its grid point
    held = float((command_line.folder / "held").read_text())
    assert len(ours[:stop]) == 2 + ticks and held <= late <= held + 2 * 0.02


@pytest.mark.soak
def test_profile_lists_share_of_every_block_and_draws_plot(command_line):
    code, out, err = command_line("profile", knee(command_line.folder), "--duration", "0.2", "-o", "bars.png")
    lines = out.splitlines()
    assert code == 0 and err == ""
    rows = {line.split()[0]: line for line in lines if " %" in line and not line.startswith("profile")}
    assert {"law", "torque_limiter", "knee"} <= set(rows)
    assert (
        rows["law"].split()[1] == "Python"
        and rows["torque_limiter"].split()[1] == "native"
        and "inside the plant" in out
    )
    assert any(line.startswith("  GIL         acquired 1 times per tick; waits ") for line in lines)
    head = (command_line.folder / "bars.png").read_bytes()[:24]
    assert (
        head[:8] == b"\x89PNG\r\n\x1a\n"
        and struct.unpack(">I", head[16:20])[0] == 1200
        and lines[-1] == "picture: bars.png"
    )


def test_run_prints_profile(command_line):
    code, out, _ = command_line(knee(command_line.folder), "--duration", "1", "--fast", "--no-record", "--profile")
    assert code == 0 and "profile: 200 ticks of " in out and "law " in out


def test_unwritable_plot_is_reported(command_line):
    code, _, err = command_line(
        "profile", knee(command_line.folder), "--duration", "0.1", "--fast", "-o", "nowhere/bars.png"
    )
    assert code == 2 and err == "tickwork: cannot write nowhere/bars.png: No such file or directory\n"


@pytest.mark.parametrize(
    "seconds, text", [(4.5e-8, "45 ns"), (9.996e-7, "1 µs"), (1.25e-6, "1.25 µs"), (0.032, "32 ms"), (2.0, "2 s")]
)
def test_three_digits_and_a_fitting_unit(seconds, text):
    assert short(seconds) == text
