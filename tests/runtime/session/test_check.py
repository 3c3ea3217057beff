"""What `check` finds, as data and as text."""

import fcntl
import json
import os
import pty
import re
import struct
import termios

import pytest

from blocks.families import families
from cext.fused import library
from graph import compile
from runtime.host.console.styles import Console, length
from runtime.host.errors import BAD_INPUT, CHECK_FAILED, OK, BadInput
from runtime.robot.loading.file import load
from runtime.session.check.report import KEYS, check
from runtime.session.check.text import bar, interval, text
from tests.runtime.runs import KNEE, KNEE_EXO, environment, knee, line_of, started, write

RATES = '''
from blocks.discrete import UnitDelay
from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from blocks.sources import Sine, StepSource
from graph import Block, Diagram, Input, Output, subsystem


class Twice(Block):
    """Doubles."""

    u = Input("1", "number")
    y = Output("1", "twice that")

    def step(self, u):
        return 2.0 * u


with Diagram("rates", rate=500) as diagram:
    fast = Sine(name="fast")()
    with subsystem("slow", every=10, enabled=StepSource(name="on")()):
        level = Gain(2.0, name="level")(fast)
    UnitDelay(name="delay")(Twice(name="second")(Twice(name="first")(Gain(name="direct")(level))))
    CsvRecorder()
'''

PLANT = """

def plant(robot):
    with Diagram("plant", rate=1000) as plant:
        robot["knee"].emulator()(position=0.0)
    return plant
"""


@pytest.fixture(scope="module")
def exo():
    return check(KNEE_EXO)


def block(found, path):
    return next(block for block in found["blocks"] if block["path"] == path)


def columns(found, width=100):
    return text(found, Console(width=width))


def test_every_port_has_its_unit_its_wire_and_its_range(exo):
    limiter = block(exo, "left/torque_limiter")
    assert limiter["inputs"] == [
        {"name": "torque", "unit": "N·m", "shape": "", "dtype": "float", "source": "left/gate.y"}
    ]
    limited = {"name": "limited", "unit": "N·m", "shape": "", "dtype": "float", "low": -12.0, "high": 12.0}
    assert limiter["outputs"] == [limited | {"targets": ["left/knee.torque_command"]}]
    knee = block(exo, "left/knee")
    assert {port["name"]: port.get("source", port.get("default")) for port in knee["inputs"]} == {
        "position_command": "0 rad",
        "velocity_command": "0 rad/s",
        "torque_command": "left/torque_limiter.limited",
        "stiffness_command": "0 N·m/rad",
        "damping_command": "0 N·m·s/rad",
        "zero": "false",
        "disable": "false",
    }
    age = next(port for port in knee["outputs"] if port["name"] == "age")
    assert (age["low"], age["high"]) == (0.0, None)


def test_the_schedule_is_the_compilers(exo):
    schedule = compile(load(KNEE_EXO)[1])
    assert [step["block"] for step in exo["schedule"]["output"]] == [step.name for step in schedule.output]
    assert all(step["native"] and step["rate"] == 200.0 and step["gil"] is None for step in exo["schedule"]["output"])
    assert exo["schedule"]["recorded"] == len(schedule.columns) and exo["schedule"]["devices"] == [
        "left/knee",
        "right/knee",
    ]


def test_the_proof_names_the_block_and_the_line_that_bounds(exo):
    [proof] = [p for p in exo["proofs"] if p["command"] == "left/knee.torque_command"]
    line = line_of(KNEE_EXO, "TorqueLimiter(limit=12.0")
    assert (proof["low"], proof["high"], proof["limit_low"], proof["limit_high"], proof["unit"]) == (
        -12.0,
        12.0,
        -18.0,
        18.0,
        "N·m",
    )
    assert (
        proof["bounded_by"] == "left/torque_limiter"
        and proof["at"].endswith(f"knee_exo.py:{line}")
        and proof["holds"]
        and proof["slew"] == 200.0
    )
    assert "rated torque" in proof["rating"] and "AK10-9-V2.0" in proof["rating"]


MIXED = """
from blocks.actuators import CubeMars, CubeMarsServo, RobStride
from graph import Diagram

with Diagram("mixed", rate=200) as diagram:
    CubeMars("AK80-9", name="hip", can_id=1, limit=5.0)(torque_command=1.0)
    CubeMars("AK10-9-V2.0", name="knee", can_id=2, limit=12.0)(stiffness_command=30.0, damping_command=1.0)
    RobStride("RS02", name="elbow", can_id=3, mode="position", range=(-1.0, 1.0))(position_command=0.1)
    CubeMarsServo("AK80-9", name="wrist", bus="two", can_id=4, mode="velocity")(velocity_command=0.1)
"""


def test_limits_by_assumption_or_in_the_drive_are_not_reported_as_proved(tmp_path, golden):
    found = check(write(tmp_path, MIXED))
    bounds = {torque["actuator"]: torque for torque in found["torque"]}
    assert {path: torque["bound"] for path, torque in bounds.items()} == {
        "hip": "proved",
        "knee": "assumed",
        "elbow": "drive",
        "wrist": "none",
    }
    assert (bounds["knee"]["limit"], bounds["knee"]["acceleration"], bounds["knee"]["holds"]) == (
        12.0,
        500.0,
        "while |α| <= 500 rad/s²",
    )
    figures = {figure["name"]: (figure["value"], figure["unit"]) for figure in bounds["knee"]["figures"]}
    assert figures["usable_damping"] == (pytest.approx(3.2), "N·m·s/rad") and figures["stall_time"] == (
        pytest.approx(0.045),
        "s",
    )
    assert set(figures) == {
        "max_transit",
        "later_command",
        "usable_damping",
        "smallest_inertia",
        "stall_time",
        "stall_torque",
        "stall_torque_slower",
    }
    assumed = {proof["command"].partition(".")[0]: proof["assumes"] for proof in found["proofs"]}
    assert (
        assumed["hip"] is None
        and assumed["knee"] == "while |α| <= 500 rad/s²"
        and "which is not verified" in assumed["elbow"]
    )
    assert [(warning["code"], warning["path"]) for warning in found["warnings"]] == [
        ("TW029", "elbow"),
        ("TW029", "wrist"),
    ]
    said = columns(found, 500)
    assert "    torque, not proved: 12 N·m, holds while |α| <= 500 rad/s²" in said
    assert "      usable damping if the whole law exceeds the limit: 3.2 N·m·s/rad" in said
    assert any(
        line.startswith("    torque, not proved: 6 N·m, limited by the drive's own current limit of ") for line in said
    )
    assert sum(line.startswith("    torque, not proved: ") for line in said) == 3
    assert said[-1].startswith("ok: every command of 1 actuator is proved, ") and said[-1].endswith(", 2 warnings")
    golden("check_mixed", said, folder=re.escape(f"{tmp_path}/"), fused=r"(?m)^  fused  .*\n(           .*\n)*")


def test_with_stiffness_at_every_joint_nothing_is_reported_as_proved(tmp_path):
    two = "".join(line + "\n" for line in MIXED.splitlines() if "elbow" not in line and "wrist" not in line)
    said = columns(check(write(tmp_path, two.replace("torque_command=1.0", "stiffness_command=5.0"))), 500)
    assert said[-1] == "ok: the torque limit of hip and knee holds while |α| <= 500 rad/s², 0 warnings"


def test_buses_and_plant_are_reported(exo):
    [bus] = exo["buses"]
    assert (bus["bus"], bus["devices"], bus["bitrate"]) == ("legs", ["left/knee", "right/knee"], 1e6)
    assert 0.0 < bus["typical"] < bus["worst"] < 0.7
    assert exo["plant"] == {"given": True, "blocks": 3, "rate": 1000.0}


def test_the_kind_of_each_line_is_reported(tmp_path):
    robot = """
from blocks.controls import Keyboard
from blocks.gpio import GpioInput
from blocks.sensors import NAU7802, Insole, Microcontroller
from graph import Diagram

with Diagram("lines", rate=200) as diagram:
    Keyboard(name="keys")
    GpioInput(name="button")
    NAU7802(bus="chips", name="cell")
    Insole(name="sole")
    Microcontroller((("x", "int8"),), name="teensy")
"""
    lines = columns(check(write(tmp_path, robot)))
    for kind in ("keys: input device", "button: GPIO line", "cell: I2C", "sole: network", "teensy: serial line"):
        assert any(line.endswith(kind) for line in lines), kind


def test_rates_conditions_and_holds_of_the_gil_are_reported(tmp_path):
    found = check(write(tmp_path, RATES))
    steps = {step["block"]: step for step in found["schedule"]["output"]}
    assert (steps["slow/level"]["rate"], steps["slow/level"]["every"], steps["slow/level"]["while"]) == (
        50.0,
        10,
        ["on.y"],
    )
    assert [steps[name]["gil"] for name in ("first", "second", "direct")] == [1, 1, None] and found["schedule"][
        "gil_sections"
    ] == 1
    assert [step["block"] for step in found["schedule"]["update"]] == ["delay"]
    assert found["holds"] == [
        {"source": "slow/level.y", "source_every": 10, "target": "direct.u", "target_every": 1},
        {"source": "fast.y", "source_every": 1, "target": "slow/level.u", "target_every": 10},
    ]
    said = "\n".join(columns(found))
    assert (
        "fast.y        → slow/level.u  one of 10 values is used" in said
        and ("slow/level.y  → direct.u  held for 10 ticks") in said
    )
    assert re.search(r"slow/level +native +50 Hz +while on\.y", said) and re.search(
        r"first +Python +500 Hz +GIL 1", said
    )
    assert (
        "each tick acquires the GIL 1 time" in said
        and found["plant"] is None
        and "proof" not in said
        and "buses" not in said
    )


def test_the_steps_in_machine_code_are_counted_and_the_others_have_a_reason(exo, monkeypatch):
    native = [step for phase in ("output", "update") for step in exo["schedule"][phase] if step["native"]]
    count = sum(step["fused"] for step in native)
    assert {step["obstacle"] for step in native} == {library.open_library()[1]} and count in (0, len(native))
    assert f"  fused    {count} of {len(native)} native steps" in columns(exo)
    monkeypatch.setattr(library, "open_library", lambda: (None, "TICKWORK_FUSED=0 in the environment"))
    lines = columns(check(KNEE_EXO))
    reason = lines[lines.index(f"  fused    0 of {len(native)} native steps") + 1]
    assert reason == "           TICKWORK_FUSED=0 in the environment"


def test_json_has_the_keys_that_the_help_documents(command_line):
    code, out, err = command_line("check", KNEE_EXO, "--json")
    found = json.loads(out)
    assert (code, err) == (OK, "")
    documented = {
        word
        for line in KEYS.splitlines()[1:]
        if line[2] != " "
        for word in re.match(r"  ([\w, ]+?)  ", line)[1].split(", ")
    }
    assert set(found) == documented
    for key in ("blocks", "proofs", "buses", "holds", "schedule", "plant"):
        one = found[key][0] if isinstance(found[key], list) and found[key] else found[key]
        for name in one:
            assert re.search(rf"\b{name}\b", KEYS), name
    with pytest.raises(SystemExit):
        command_line("check", "--help")
    assert KEYS in command_line.capsys.readouterr().out


def test_nothing_is_wider_than_the_terminal(exo, tmp_path):
    for found in (exo, check(write(tmp_path, RATES)), check(KNEE_EXO, [("left/torque_limiter.limit", "30")])):
        for line in columns(found):
            assert length(line) <= 100 or str(tmp_path) in line, line  # a path is never cut, however long it is


def test_in_a_pipe_each_fact_is_one_line_without_colours(command_line, golden):
    code, out, err = command_line("check", KNEE_EXO)
    golden("check_knee_exo", out, fused=r"(?m)^  fused  .*\n(           .*\n)*")
    assert code == OK and "\x1b" not in out
    [row] = [line for line in out.splitlines() if "[-12.5, 12.5]" in line and "left/" in line]
    assert row.split("→")[1].strip() == "left/events.angle, left/gait_phase.angle, left/stride_report.angle"


def test_on_a_terminal_output_is_coloured_and_fills_its_width(tmp_path):
    knee(tmp_path)
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 72, 0, 0))
    how = {"stdin": theirs, "stdout": theirs, "stderr": None, "env": environment(TERM="xterm", COLUMNS="")}
    process = started("check", "robot.py", cwd=tmp_path, **how)
    os.close(theirs)
    said = b""
    while True:
        try:
            piece = os.read(ours, 65536)
        except OSError:  # the other end is closed
            break
        if not piece:
            break
        said += piece
    os.close(ours)
    assert process.wait(timeout=60) == OK
    lines = said.decode().splitlines()
    assert any("\x1b[1mports\x1b[0m" in line for line in lines) and max(map(length, lines)) <= 72


def test_errors_are_reported_with_code_location_and_hint_and_exit_code_1(command_line):
    code, out, err = command_line("check", KNEE_EXO, "--set", "left/torque_limiter.limit=30", "--json")
    found = json.loads(out)
    assert (code, err, found["ok"], found["schedule"]) == (CHECK_FAILED, "", False, None)
    [error] = found["errors"]
    assert (error["code"], error["title"]) == ("TW007", "command not provably inside its limit")
    assert (error["path"], error["port"]) == ("left/knee", "torque_command")
    assert error["at"].endswith(f"knee_exo.py:{line_of(KNEE_EXO, 'knee(torque_command')}")
    assert "[-30, 30] N·m" in error["message"] and "limiter" in error["hint"]
    [proof] = [p for p in found["proofs"] if p["command"] == "left/knee.torque_command"]
    assert not proof["holds"]
    code, out, err = command_line("check", KNEE_EXO, "--set", "left/torque_limiter.limit=30")
    assert (code, err) == (CHECK_FAILED, "") and out.splitlines()[-1] == ("1 error, 0 warnings: the diagram cannot run")


def test_a_parameter_that_was_assigned_a_wrong_value_fails_the_check(tmp_path):
    path = write(tmp_path, KNEE.format(law="return 0.0") + '    knee.can_id = "two"\n')
    [error] = check(path)["errors"]
    assert error["code"] == "TW010" and error["message"] == "can_id: expected a number, got 'two'"


def test_a_block_whose_construction_fails_fails_the_check(command_line):
    path = write(command_line.folder, KNEE.format(law="return 0.0").replace("limit=5.0", "limit=-5.0"))
    code, out, err = command_line("check", "robot.py", "--json")
    [error] = json.loads(out)["errors"]
    assert (code, err, error["code"], error["at"]) == (
        CHECK_FAILED,
        "",
        "TW010",
        f"robot.py:{line_of(path, 'limit=-5.0')}",
    )
    assert set(json.loads(out)) == set(check(KNEE_EXO))
    assert "at least 0.0 N·m" in command_line("check", "robot.py")[1]


def test_a_plant_that_does_not_compile_fails_the_check(command_line):
    write(command_line.folder, KNEE.format(law="return 0.0") + PLANT)
    code, out, err = command_line("check", "robot.py")
    assert (code, err) == (CHECK_FAILED, "") and "TW001 unconnected input: emulated_cube_mars.velocity" in out


def test_a_file_that_cannot_be_read_is_bad_input(command_line):
    write(command_line.folder, "1 +", "broken.py")
    assert "syntax error" in command_line.refused("check", "broken.py", code=BAD_INPUT)
    with pytest.raises(BadInput, match="does not exist"):
        check(command_line.folder / "nothing.py")


def test_the_file_may_run_at_another_rate(tmp_path):
    found = check(knee(tmp_path), rate=500.0)
    assert found["rate"] == 500.0 and found["schedule"]["output"][0]["rate"] == 500.0
    assert found["plant"] == {"given": False, "blocks": 2, "rate": 2500.0}
    assert "no plant: every device emulated, at 2500 Hz" in columns(found, None)[0]


def test_the_bar_of_an_interval_shows_its_position_in_the_limit():
    proof = {"low": -12.0, "high": 12.0, "limit_low": -24.0, "limit_high": 24.0}
    assert bar(proof) == "├" + "─" * 6 + "█" * 10 + "─" * 6 + "┤"
    assert bar(proof | {"low": 0.0, "high": 0.0}).count("█") == 1
    assert bar(proof | {"low": -24.0, "high": 24.0}) == "├" + "█" * 22 + "┤"
    assert bar(proof | {"low": None}).strip() == ""


def test_intervals_are_formatted_with_infinities():
    assert [interval(*ends) for ends in ((-1.0, 2.5), (0.0, None), (None, 3.0), (None, None))] == [
        "[-1, 2.5]",
        "[0, ∞]",
        "[-∞, 3]",
        "",
    ]


def test_the_stop_of_a_damped_joint_is_reported(command_line):
    write(
        command_line.folder, KNEE.format(law="return 0.0").replace("can_id=", 'safe_stop="damp", can_id='), "damped.py"
    )
    code, out, err = command_line("check", "damped.py")
    assert (code, err) == (OK, "") and "    safe stop: damped within 18 N·m for 1 s then disable\n" in out


def test_check_reports_the_slew_rate_of_a_torque(tmp_path, command_line):
    """Ten newton metres, from end to end in 0.1 s, where the limiter has no slew; and that it may step where it asks
    for that.
    """
    out = command_line("check", knee(tmp_path))[1]
    assert "; at most 100 N·m/s: full range in 0.1 s" in " ".join(out.split())
    text = knee(tmp_path).read_text().replace("(limit=5.0)", "(limit=5.0, slew=math.inf)")
    assert "; rate not limited" in " ".join(command_line("check", write(tmp_path, text))[1].split())


NOT_READ_BACK = {
    'CubeMars("AK80-9"': "mode, current limit, time-out",
    'CubeMarsServo("AK80-9"': "report rate, current limit, time-out",
    'CubeMarsServo("AK80-9", mode="velocity"': "report rate, current limit, time-out",
    'CubeMarsV3("AK80-9-V3.0"': "report rate, current limit",
    'RobStride("RS02"': None,
    'RobStride("RS02", can_timeout=0.0, mode="velocity"': None,
    'RobStrideMIT("RS02"': None,
    'RobStrideMIT("RS02", can_timeout=0.0': "mode, torque limit, time-out",
}


@pytest.mark.hazard("H1i")
@pytest.mark.parametrize("drive, names", NOT_READ_BACK.items(), ids=NOT_READ_BACK)
def test_check_prints_the_settings_that_are_not_read_back_of_each_family(command_line, drive, names):
    """In a pipe, where each fact is a line, and wherever its torque is proved or not."""
    kind, command = drive.split("(")[0], "velocity_command" if "velocity" in drive else "torque_command"
    command = "current_command" if drive == 'CubeMarsServo("AK80-9"' else command
    lines = (
        f"from blocks.actuators import {kind}",
        "from graph import Diagram",
        'with Diagram("robot", rate=200) as diagram:',
        f'    {drive}, can_id=1, name="knee")({command}=0.5)',
    )
    code, out, _ = command_line("check", write(command_line.folder, "\n".join(lines), "drive.py"))
    printed = [line for line in out.splitlines() if "read back" in line]
    assert code == OK and printed == ([f"    settings not read back: {names}"] if names else [])


def test_the_drives_of_every_family_are_tried():
    assert {drive.block.__name__ for family in families() for drive in family.drives} == {
        drive.split("(")[0] for drive in NOT_READ_BACK
    }
