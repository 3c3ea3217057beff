"""The end of a run: summary, faults, exit codes, and three suggestions."""

import os
import signal
from pathlib import Path

import pytest

from cext.schedule.outcome import Outcome
from runtime.record.analysis.trial import Trial
from runtime.record.recorder import RecorderProcess
from runtime.record.report import fault, summary, timing
from runtime.session.prepare import prepare
from runtime.session.request import Request
from runtime.session.session import Session
from tests.runtime.runs import KNEE, KNEE_EXO, finished, knee, line_of, write, writer_of
from tests.runtime.terminals import patient

PUSHED = """
from blocks.sources import Pulse
from blocks.wearer import Walker


def plant(robot):
    with Diagram("wearer", rate=1000) as wearer:
        motion = Walker(name="walker")(left_knee_assistance=Pulse(low=150.0, high=-150.0, unit="N·m")())
        robot["knee"].emulator()(position=motion.left_knee_angle, velocity=motion.left_knee_velocity)
    return wearer
"""


def outcome(status="ok", number=0):
    return Outcome(status, None, 99, number, None, (), ())


def carry_out(file, duration=1.0, **more):
    return Session(prepare(Request(Path(file), duration=duration, fast=True, no_record=True, **more))).carry_out()


@pytest.fixture(scope="module")
def walked():
    """10 s of the knee exoskeleton in virtual time."""
    return carry_out(KNEE_EXO, 10.0)


@pytest.mark.parametrize(
    "ended, code",
    [
        (outcome(), 0),
        (outcome("not finite"), 3),
        (outcome("exception", signal.SIGINT), 3),
        (outcome(number=signal.SIGINT), 130),
        (outcome(number=signal.SIGTERM), 143),
        (outcome(number=signal.SIGHUP), 129),
    ],
)
def test_exit_codes_follow_the_outcome(ended, code):
    assert summary.exit_code(ended) == code


def test_a_short_recording_has_an_exit_code_of_its_own_and_others_take_precedence():
    ends = outcome(), outcome("not finite"), outcome(number=signal.SIGINT)
    assert [summary.exit_code(ended, "1 record lost") for ended in ends] == [4, 3, 130]


def test_signals_are_named_and_ctrl_c_is_explained():
    assert summary.stop_reason(outcome()) is None
    assert summary.stop_reason(outcome(number=signal.SIGINT)) == "stopped by SIGINT (Ctrl-C)"
    assert summary.stop_reason(outcome(number=signal.SIGTERM)) == "stopped by SIGTERM"


def test_the_summary_counts_ticks_strides_torque_and_work(walked, golden):
    lines = summary.summary(walked)
    golden("summary", lines, speed=r"(?m)(?<=^  speed  ).*")
    assert lines[0] == "knee_exo: 10 s at 200 Hz, simulated, in virtual time"
    assert lines[1] == "  ticks       2000 of 2000 done, 0 missed; 0 records dropped"
    assert any(line.startswith("  speed       ") and " times real time: " in line for line in lines)
    assert "  buses       legs: 4012 frames sent, 4012 received" in lines
    for side in ("left", "right"):
        [line] = [line for line in lines if line.startswith(f"  {side}")]
        for part in ("strides of 1.10 s", "peak torque 9.", "positive work ", " J per stride, negative -"):
            assert part in line
    assert "  safe stop   zero torque, then disable: confirmed by left/knee, right/knee" in lines


def test_summary_reports_clock_only_in_real_time(walked, tmp_path):
    assert not any(line.startswith(("  rate", "  late by", "  load")) for line in summary.summary(walked))
    lines = summary.summary(Session(prepare(Request(knee(tmp_path), duration=0.3, no_record=True))).carry_out())
    assert [line.split()[0] for line in lines[1:6]] == ["plant", "ticks", "rate", "late", "load"]
    assert "µs median" in lines[4] or "ms median" in lines[4]


def test_unknown_plant_is_reported(tmp_path):
    lines = summary.summary(carry_out(knee(tmp_path)))
    assert "  plant       none in the file: every device is emulated, and each actuator drives a free inertia" in lines


def test_run_in_which_the_wearer_exceeds_a_limit_is_not_valid(tmp_path, walked):
    file = knee(tmp_path)
    file.write_text(file.read_text() + PUSHED)
    result = carry_out(file, 2.0)
    [line] = [line for line in summary.summary(result) if "NOT VALID" in line]
    assert line.startswith("  NOT VALID   walker: the knee exceeds its stop by more than 5° after 1.")
    assert result.end_event()["implausible"] in line
    assert not any("NOT VALID" in line for line in summary.summary(walked))


def test_speed_is_measured_with_the_wall_clock(walked):
    """However short the ticks are: waiting for the recorder is part of it."""
    [line] = [line for line in summary.summary(walked) if line.startswith("  speed")]
    assert int(line.split()[1]) == round(10.0 / walked.seconds)


@pytest.mark.parametrize(
    "seconds, text",
    [
        (4e-7, "0.4 µs"),
        (9.94e-6, "9.9 µs"),
        (2e-5, "20 µs"),
        (9.994e-4, "999 µs"),
        (1.5e-3, "1.5 ms"),
        (0.25, "250.0 ms"),
    ],
)
def test_durations_have_a_fitting_unit(seconds, text):
    assert timing.micro(seconds) == text


def test_summary_describes_strides():
    stride = {
        "strides": 1,
        "left_out": 2,
        "stride_time": 1.104,
        "peak_torque": 9.21,
        "positive_work": 3.456,
        "negative_work": -4.0,
    }
    assert summary.stride_text(stride) == (
        "1 stride of 1.10 s (2 excluded); peak torque 9.2 N·m; positive work 3.46 J per stride, negative -4.00 J"
    )
    assert summary.stride_text(stride | {"strides": 0, "left_out": 0}) == "no complete stride; peak torque 9.2 N·m"
    assert summary.stride_text(stride | {"negative_work": -0.004}).endswith("negative 0.00 J")


def test_summary_describes_stride_signals_and_unused_ones():
    stride = {
        "title": "left",
        "left_out": 3,
        "left_out_because": {"with missed ticks": 1, "longer than 4 s": 2},
        "unused": {"standing": 1.5, "unfinished": 2.26},
        "signals": {
            "phase": "left/gait.phase",
            "walking": "left/gait.walking",
            "angle": "left/knee.position",
            "velocity": "left/filter.y",
            "torque": "left/knee.torque",
        },
    }
    assert list(summary.stride_details(stride)) == [
        "excluded: 1 with missed ticks, 2 longer than 4 s",
        "work of knee.torque and filter.y, angle knee.position, phase gait.phase; not used: 1.5 s without walking, "
        "2.3 s of walking outside complete strides",
    ]
    whole = stride | {"left_out": 0, "left_out_because": {}, "unused": {"standing": 0.0, "unfinished": 0.0}}
    assert list(summary.stride_details(whole)) == [
        "work of knee.torque and filter.y, angle knee.position, phase gait.phase"
    ]


def test_three_things_to_try_next(walked, tmp_path):
    lines = summary.hints(walked, "tickwork")
    assert lines[0] == "try next" and len(lines) == 4
    assert f"  change a parameter: tickwork {KNEE_EXO} --duration 10 --set left/profile.scale=0.5" in lines
    lines = summary.hints(carry_out(knee(tmp_path)), "python -m runtime")
    assert lines[1:] == [
        f"  show what is proved: python -m runtime check {tmp_path / 'robot.py'}",
        "  measure this machine: python -m runtime bench",
    ]


def test_the_hint_on_plotjuggler_names_the_port_that_the_run_sends_to(tmp_path):
    viewer = "PlotJuggler(port=9999, virtual_time=True)"
    text = KNEE.format(law="return 1.0").replace("CsvRecorder()", f"CsvRecorder()\n    {viewer}")
    path = write(
        tmp_path, text.replace("import CsvRecorder", "import CsvRecorder\nfrom blocks.sinks import PlotJuggler")
    )
    assert any("UDP Server, port 9999, JSON" in line for line in summary.hints(carry_out(path), "tickwork"))


def test_a_file_with_a_space_in_its_name_is_quoted(tmp_path):
    path = write(tmp_path, KNEE.format(law="return 1.0"), "my robot.py")
    assert summary.hints(carry_out(path), "tickwork")[1] == f"  show what is proved: tickwork check '{path}'"


def test_a_file_whose_name_begins_like_an_option_is_suggested_with_its_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, KNEE.format(law="return 1.0"), "-robot.py")
    assert summary.hints(carry_out("-robot.py"), "tickwork")[1] == "  show what is proved: tickwork check ./-robot.py"


def test_walk_without_whole_stride_suggests_longer_walk():
    lines = summary.hints(carry_out(KNEE_EXO, 1.0), "tickwork")
    assert lines[1] == f"  record complete strides: tickwork {KNEE_EXO} --duration 20"


def test_suggested_command_works(walked):
    """A parameter's other value is one that it may take."""
    [line] = [line for line in summary.hints(walked, "tickwork") if "--set" in line]
    setting = line.rpartition("--set ")[2].partition("=")
    prepare(Request(KNEE_EXO, duration=1.0, fast=True, settings=[(setting[0], setting[2])]))


def explained(tmp_path, law="return 1.0", text="", **more):
    """(lines about the fault, path of the file) of a knee whose law or plant goes wrong."""
    path = write(tmp_path, KNEE.format(law=law) + text)
    return fault.explain(carry_out(path, **more)), path


def test_an_exception_shows_the_users_lines_only(tmp_path):
    write(tmp_path, "def gain(table):\n    return table['gain']\n", "gains_of_mine.py")
    lines, path = explained(
        tmp_path, law="import gains_of_mine\n        return gains_of_mine.gain({}) if tick == 7 else 0.0"
    )
    assert lines[0] == "FAULT at law, tick 7 (0.035 s): its step raised an exception"
    assert lines[1].startswith("  its inputs: position = ")
    assert lines[2:5] == [
        f"  {path}:{line_of(path, 'return gains_of_mine')} in step: return gains_of_mine.gain({{}}) if tick == 7 "
        "else 0.0",
        f"  {tmp_path / 'gains_of_mine.py'}:2 in gain: return table['gain']",
        "  KeyError: 'gain'",
    ]
    assert lines[-1] == "  actuators stay disabled until the next arming: fix the cause, then arm again"


def test_fault_shows_last_ticks_and_commands_and_replies_of_actuators(tmp_path):
    path = write(tmp_path, KNEE.format(law="return math.nan if tick == 9 else tick / 8"))
    result = carry_out(path)
    lines = fault.explain(result)
    begin = lines.index("  ticks before the fault:")
    header, *rows = [line.split() for line in lines[begin + 1 : begin + 10]]
    assert header == ["tick", "3", "4", "5", "6", "7", "8", "9", "(fault)"]
    [torque] = [row for row in rows if row[0] == "torque_limiter.limited"]
    assert torque[3:] == ["0.375", "0.5", "0.625", "0.75", "0.875", "1", "nan"]
    [angle] = [row for row in rows if row[0] == "knee.position"]
    known = result.control.final[result.schedule.signals["knee.position"].slot]
    # before the stop was answered
    assert float(angle[-1]) == pytest.approx(known, rel=1e-3) and f"position {known:.4g} rad" in lines[-2]
    assert lines[-4].startswith("  knee: last reply ")
    sent = result.newest[-1][
        2 + next(column.index for column in result.schedule.recorded if column.path == "knee.torque_sent")
    ]
    assert lines[-3] == f"    command   torque nan N·m; torque sent {sent:.4g} N·m"
    assert sent == pytest.approx(1.0 * 8 / 100, abs=0.04)


def test_the_report_of_a_fault_is_in_the_recording(tmp_path):
    path = write(tmp_path, KNEE.format(law="return math.nan if tick == 9 else 1.0"))
    result = Session(prepare(Request(path, duration=1.0, fast=True, record=tmp_path / "out"))).carry_out()
    [file] = (tmp_path / "out").glob("*.mcap")
    assert Trial(file).end["end"]["report"] == fault.explain(result)


def test_exception_inside_library_shows_calling_line(tmp_path):
    lines, path = explained(tmp_path, law="import numpy\n        return numpy.linalg.inv(numpy.zeros((2, 2)))[0, 0]")
    assert lines[2] == f"  {path}:{line_of(path, 'linalg')} in step: return numpy.linalg.inv(numpy.zeros((2, 2)))[0, 0]"
    assert "Singular matrix" in lines[3]


def test_step_with_wrong_return_value(tmp_path):
    lines, _ = explained(tmp_path, law="return None")
    assert "TypeError" in lines[2] and "law" in lines[2] and "None" in lines[2]


def test_nan_is_traced_to_the_block_that_made_it(tmp_path):
    """Through every block in between, also a filter."""
    text = KNEE.replace("(limit=5.0)(torque)", "(limit=5.0)(Gain(2.0)(Butterworth(2, 20.0)(torque)))").replace(
        "from blocks.limiters",
        "from blocks.filters import Butterworth\nfrom blocks.mathematics import Gain\nfrom blocks.limiters",
    )
    path = write(tmp_path, text.format(law="return math.nan if tick == 42 else 0.0"))
    lines = fault.explain(carry_out(path))
    assert lines[0] == "FAULT at knee, tick 42 (0.21 s): a command is NaN or infinite"
    assert lines[2].startswith(
        f"  first non-finite signal: law.torque = nan, created at {path}:{line_of(path, 'Law(name')}, "
        "with inputs position = "
    )


def traced(tmp_path, wired, imports, law="return 1.0", before=""):
    """The report's line about the origin, of a knee whose torque runs through `wired`, with one line of the diagram in
    front.
    """
    text = (
        KNEE.replace("(limit=5.0)(torque)", f"(limit=5.0)({wired})")
        .replace("    knee(torque", f"    {before}\n    knee(torque")
        .replace("from blocks.limiters", f"{imports}\nfrom blocks.limiters")
    )
    lines = fault.explain(carry_out(write(tmp_path, text.format(law=law))))
    assert lines[0].startswith("FAULT at knee, tick ") and lines[0].endswith("a command is NaN or infinite")
    return lines[2].replace(str(tmp_path), "")


def test_an_infinity_is_traced_through_the_limiter_that_returned_nan(tmp_path):
    line = traced(
        tmp_path,
        'Divide(name="share")(torque, StepSource(before=2.0, after=0.0, time=0.2, unit="1", name="step")())',
        "from blocks.mathematics import Divide\nfrom blocks.sources import StepSource",
    )
    assert line == "  first non-finite signal: share.y = inf, created at /robot.py:27, with inputs a = 1, b = 0"


def test_a_filter_that_holds_a_nan_is_reported(tmp_path):
    """The NaN came at tick 10 and nothing used it until tick 20, when the filter alone still had it."""
    line = traced(
        tmp_path,
        'Switch()(Compare(">")(Clock(name="clock").time, 0.0999), Butterworth(2, 20.0, name="smooth")(torque), 0.0)',
        "from blocks.clock import Clock\nfrom blocks.filters import Butterworth\nfrom blocks.logic import Compare, "
        "Switch",
        law="return math.nan if tick == 10 else 1.0",
    )
    assert line.startswith("  first non-finite signal: smooth.y = nan, created at /robot.py:") and line.endswith(
        ", with inputs u = 1"
    )


def test_the_origin_of_an_infinity_in_a_loop_is_found(tmp_path):
    """From tick 10 on the loop and what feeds it are infinite; from tick 20 on the drive would be commanded by it."""
    line = traced(
        tmp_path,
        'Switch()(Compare(">")(Clock(name="clock").time, 0.0999), total, 0.0)',
        "from blocks.clock import Clock\nfrom blocks.discrete import UnitDelay\nfrom blocks.logic import Compare, "
        "Switch\nfrom blocks.mathematics import Sum",
        law="return math.inf if tick >= 10 else 1.0",
        before='delay = UnitDelay(name="delay"); total = Sum("++")(delay.y, torque); delay(total)',
    )
    assert line.startswith("  first non-finite signal: law.torque = inf, created at /robot.py:")


FAULTY_PLANT = '''

class Trouble(Block):
    """Goes wrong at t = 0.5 s."""

    {port}

    def step(self, t):
        {step}


def plant(robot):
    from blocks.models import Limb

    with Diagram("wearer", rate=1000) as wearer:
        drive = robot["knee"].emulator()
        limb = Limb()
        {wiring}
    return wearer
'''


def test_a_device_that_reports_a_fault_shows_its_readings(tmp_path, golden):
    lines, _ = explained(
        tmp_path,
        text=FAULTY_PLANT.format(
            port='code = Output("1", dtype=int)',
            step="return 3 if t > 0.5 else 0",
            wiring="limb(torque=drive.torque)\n        drive(position=limb.position, velocity=limb.velocity, "
            "fault=Trouble()())",
        ),
    )
    assert lines[0].startswith("FAULT at knee, tick 10") and lines[0].endswith(": the device reports a fault")
    golden("fault_over_voltage", lines)
    assert lines[1].startswith("  reported fault: over-voltage (position = ") and ", fault = 3," in lines[1]
    assert "fault: over-voltage, last reply 5.0 ms before, stop confirmed" in lines[-4]


def test_table_of_a_fault_marks_a_drive_that_was_taken_out(tmp_path):
    path = write(
        tmp_path,
        """
from blocks.actuators import CubeMars
from blocks.safety import EmergencyStop
from blocks.logic import Compare
from blocks.sources import Ramp
from graph import Diagram

with Diagram("robot", rate=200) as diagram:
    for number, name in enumerate(("left", "right"), 1):
        CubeMars("AK80-9", can_id=number, name=name, disabled=name == "left")(torque_command=0.0)
    EmergencyStop()(Compare(">")(Ramp()(), 0.1))
""",
    )
    lines = finished(path, "--fast", "--duration", "1", "--no-record", cwd=tmp_path).stderr.splitlines()
    [left] = [line for line in lines if line.startswith("  left: ")]
    [right] = [line for line in lines if line.startswith("  right: ")]
    assert ": taken out, last reply 5.0 ms before, stop confirmed" in left and "taken out" not in right
    assert "active" not in left


def test_fault_in_plant_is_labelled(tmp_path):
    lines, path = explained(
        tmp_path,
        text=FAULTY_PLANT.format(
            port='torque = Output("N·m")',
            step="return 1.0 / 0.0 if t > 0.5 else 0.0",
            wiring="limb(torque=Trouble()())\n        drive(position=limb.position, velocity=limb.velocity)",
        ),
    )
    assert lines[0].startswith("FAULT at trouble of wearer, the plant, tick 9") and lines[0].endswith(
        ": its step raised an exception"
    )
    assert f"  {path}:{line_of(path, '1.0 / 0.0')} in step: return 1.0 / 0.0 if t > 0.5 else 0.0" in lines
    lines, _ = explained(
        tmp_path,
        text=FAULTY_PLANT.format(
            port='torque = Output("N·m")',
            step="return math.nan if t > 0.5 else 0.0",
            wiring="limb(torque=Trouble()())\n        drive(position=limb.position, velocity=limb.velocity)",
        ),
    )
    assert ": its emulated reply contains NaN or infinity" in lines[0] and "the plant" in lines[0]


def test_dead_recorder_is_reported_and_run_continues(tmp_path, monkeypatch):
    class Short(RecorderProcess):
        """Is killed as soon as it is ready."""

        def configure(self, plan):
            super().configure(plan)
            os.kill(patient(lambda: writer_of(self.pid)), signal.SIGKILL)

    monkeypatch.setattr("runtime.session.session.RecorderProcess", Short)
    result = Session(prepare(Request(knee(tmp_path), duration=0.3, no_record=True))).carry_out()
    assert result.outcome.status == "ok"
    [line] = [line for line in summary.summary(result) if line.startswith("  recorder")]
    assert "the writer of part 1 died (SIGKILL); part 2 continues the recording; no record was lost" in line


def test_ctrl_c_while_the_recording_is_finished_does_not_tear_it(tmp_path, monkeypatch):
    class Interrupted(RecorderProcess):
        """Handles Ctrl-C again after the run."""

        def finish(self):
            os.kill(os.getpid(), signal.SIGINT)
            return super().finish()

    monkeypatch.setattr("runtime.session.session.RecorderProcess", Interrupted)
    before = signal.getsignal(signal.SIGINT)
    result = Session(
        prepare(Request(knee(tmp_path), duration=0.5, fast=True, record=tmp_path / "recordings"))
    ).carry_out()
    assert result.recording["ended"] == "ok" and result.recording["ticks"] == 100
    assert signal.getsignal(signal.SIGINT) is before
