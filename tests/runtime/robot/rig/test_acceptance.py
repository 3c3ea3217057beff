"""A torque limit that may not hold is named by `check` and before arming, and on a rig it must be accepted."""

import json

import pytest

from graph import Diagram, compile
from runtime.host.errors import BAD_INPUT, BadInput
from runtime.robot.rig.acceptance import require_acceptance
from runtime.robot.rig.errors import RigError
from runtime.robot.rig.file import parse
from runtime.robot.rig.overrides import override
from runtime.session.own_process import words
from tests.runtime.robot.guardian.bus import PATIENT, ROBOT, Bus
from tests.runtime.runs import Files, finished, write

KNEE = """
from dataclasses import replace

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, RobStride, RobStrideMIT
from blocks.actuators.cubemars import models
from blocks.recorders import CsvRecorder
from graph import Diagram


class Lab(CubeMars):
    find = staticmethod(lambda name: replace(models.find(name), wire_torque=9.0))


with Diagram("robot", rate=200) as diagram:
    knee = {drive}
    knee({command})
    CsvRecorder()
"""
TORQUE = 'CubeMars("AK10-9-V2.0", bus="legs", name="knee", limit=9.0, range=(-3.0, 3.0){more})'
SERVO = 'CubeMarsServo("AK10-9-V3.0", bus="legs", name="knee", limit=5.0, range=(-3.0, 3.0){more})'
RS = 'RobStride("RS02", bus="legs", name="knee", limit=3.0, range=(-3.0, 3.0){more})'
MIT = 'RobStrideMIT("RS04", bus="legs", name="knee", limit=9.0, range=(-3.0, 3.0){more})'
LEGS = '[bus.legs]\ninterface = "udp_multicast"\nchannel = "239.7.9.{number}"\n[device.knee]\n'

# (drive, its command, lines of the rig file, options, name to accept, words)
SCALED = [
    (TORQUE, "torque_command=2.0", "wire_torque = 9.0", (), "wire_torque", "7.22 times the commanded torque"),
    (TORQUE, "torque_command=2.0", "", ("--set", "knee.wire_torque=9"), "wire_torque", "7.22 times the commanded"),
    (
        TORQUE.format(more=", wire_torque=9.0"),
        "torque_command=2.0",
        "",
        (),
        "wire_torque",
        "7.22 times the commanded torque",
    ),
    (
        TORQUE.replace("CubeMars(", "Lab("),
        "torque_command=2.0",
        "",
        (),
        "wire_torque",
        "7.22 times the commanded torque",
    ),
    (TORQUE, "stiffness_command=20.0", "wire_stiffness = 50.0", (), "wire_stiffness", "a stiffness gives 10 times"),
    (TORQUE, "damping_command=1.0", "wire_damping = 1.0", (), "wire_damping", "a damping gives 5 times its torque"),
    (TORQUE, "stiffness_command=20.0", "wire_position = 6.25", (), "wire_position", "2 times as far as reported"),
    (TORQUE, "damping_command=1.0", "wire_velocity = 10.0", (), "wire_velocity", "5 times as fast as reported"),
    (TORQUE, "torque_command=2.0", "", ("--set", "knee.gear_ratio=0.5"), "gear_ratio", "2 times the commanded torque"),
    (MIT, "damping_command=1.0", "", (), "ranges", "a damping gives 20 times its torque"),
    (RS, "torque_command=2.0", "wire_torque = 3.4", (), "wire_torque", "5 times the commanded torque"),
    (
        SERVO.format(more=", torque_constant=0.3"),
        "current_command=1.0",
        "",
        (),
        "torque_constant",
        "4.38 times the commanded torque",
    ),
    (SERVO.format(more=', mode="position"'), "position_command=0.1", "", (), "mode", "no torque limit in this mode"),
    (SERVO.format(more=', mode="velocity"'), "velocity_command=0.1", "", (), "mode", "no torque limit in this mode"),
    (
        SERVO.format(more=', mode="position_velocity"'),
        "position_command=0.1",
        "",
        (),
        "mode",
        "no torque limit in this mode",
    ),
    (SERVO.format(more=', mode="duty"'), "duty_command=0.05", "", (), "mode", "no torque limit in this mode"),
    (RS.format(more=', mode="csp"'), "position_command=0.1", "", (), "mode", "inside the drive, not verified"),
    (RS.format(more=', mode="position"'), "position_command=0.1", "", (), "mode", "inside the drive, not verified"),
    (RS.format(more=', mode="velocity"'), "velocity_command=0.1", "", (), "mode", "inside the drive, not verified"),
]
CASES = pytest.mark.parametrize("drive, command, device, options, name, effect", SCALED)


def robot(folder, drive, command, device):
    """(diagram file, rig file)"""
    text = KNEE.format(drive=drive.format(more=""), command=command)
    return write(folder, text), write(folder, LEGS.format(number=1) + device + "\n", "lab.toml")


@pytest.mark.hazard("H1h")
@CASES
def test_check_warns_of_it_and_never_reports_the_limit_as_proved(
    command_line, drive, command, device, options, name, effect
):
    file, rig = robot(command_line.folder, drive, command, device)
    code, out, _ = command_line("check", file, "--rig", rig, *options)
    said = " ".join(out.split())
    assert code == 0 and ("warning TW028" in said or "warning TW029" in said)
    assert effect in said and f"--accept knee.{name}" in said
    assert "every command of 1 actuator is proved" not in said and "0 warnings" not in said
    report = json.loads(command_line("check", file, "--rig", rig, *options, "--json")[1])
    [caveat] = report["caveats"]
    assert (caveat["actuator"], caveat["setting"]) == ("knee", name) and effect in caveat["words"]


@pytest.mark.hazard("H1h")
@CASES
def test_a_rig_is_not_armed_without_acceptance(command_line, drive, command, device, options, name, effect):
    file, rig = robot(command_line.folder, drive, command, device)
    said = command_line.refused("run", file, "--rig", rig, "--yes", "--no-record", *options)
    assert "error TW138 limit that may not hold: knee: " in said and effect in said
    assert f"--accept knee.{name}" in said


@pytest.mark.hazard("H1h")
@pytest.mark.parametrize("ranges, damping", [("mit", 5.0), ("private", 100.0)])
def test_a_rig_that_states_the_ranges_of_the_unit_needs_no_acceptance(command_line, ranges, damping):
    file, rig = robot(command_line.folder, MIT, "damping_command=1.0", f'ranges = "{ranges}"')
    code, out, _ = command_line("check", file, "--rig", rig)
    assert code == 0 and "TW028" not in out and "TW138" not in out
    file, rig = robot(command_line.folder, MIT, f"damping_command={damping + 0.1}", f'ranges = "{ranges}"')
    code, out, _ = command_line("check", file, "--rig", rig)
    assert code == 1 and f"command a value from 0 to {damping:g} N·m·s/rad" in out


def test_a_simulation_needs_no_acceptance_and_prints_the_warning(command_line):
    file, _ = robot(command_line.folder, TORQUE, "torque_command=2.0", "")
    words = ("--fast", "--duration", "0.1", "--no-record", "--set", "knee.wire_torque=9")
    code, out, err = command_line("run", file, *words)
    assert code == 0 and "warning TW028" in err and "knee: wire_torque = 9 N·m (--set), but 65 N·m" in out
    assert "--accept needs --rig" in command_line.refused("run", file, *words, "--accept", "knee.wire_torque")


def scaled(tmp_path, text):
    from blocks.actuators import CubeMars

    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", bus="legs", name="knee", limit=9.0)(torque_command=2.0)
    rig = parse(tmp_path / "lab.toml", LEGS.format(number=1) + text)
    override(rig, robot)
    return compile(robot).caveats


def test_every_caveat_is_accepted_by_its_own_name(tmp_path):
    caveats = scaled(tmp_path, "wire_torque = 9.0\nwire_position = 6.0\n")
    both = ["knee.wire_torque", "knee.wire_position"]
    require_acceptance("lab.toml", caveats, both)
    for name in both:
        with pytest.raises(RigError) as refused:
            require_acceptance("lab.toml", caveats, [name])
        [problem] = refused.value.problems
        assert problem.code == "TW138" and next(other for other in both if other != name) in problem.hint


@pytest.mark.parametrize(
    "text, name, hint",
    [
        ("wire_torque = 65.0\n", "knee.wire_torque", "remove it"),
        ("wire_torque = 9.0\n", "knee.wire_torqe", "did you mean 'knee.wire_torque'?"),
        ("wire_torque = 9.0\n", "hip.limit", "to accept: knee.wire_torque"),
    ],
)
def test_an_acceptance_without_a_caveat_is_an_error(tmp_path, text, name, hint):
    with pytest.raises(BadInput, match=f"--accept {name}: nothing to accept under this name; ") as refused:
        require_acceptance("lab.toml", scaled(tmp_path, text), [name])
    assert str(refused.value).endswith(hint)


def test_a_program_passes_several_acceptances():
    given = ["--accept=knee.wire_torque", "--accept=knee.mode"]
    assert words((), {"accept": ["knee.wire_torque", "knee.mode"]}) == given


def test_move_in_a_mode_without_a_torque_limit_must_accept_it(command_line):
    rig = write(command_line.folder, LEGS.format(number=1).partition("[device")[0], "lab.toml")
    code, _, err = command_line(
        *("move", "3", "--rig", rig, "--bus", "legs", "--model", "AK10-9-V3.0", "--servo", "--position", "0.3", "--yes")
    )
    assert code == BAD_INPUT and "no torque limit in this mode" in err and "--accept actuator.mode" in err


@pytest.mark.paced
def test_accepted_setting_is_in_table_summary_and_recording(tmp_path):
    with Bus(tmp_path, number=7) as bus:
        device = '[device."left/knee"]\nwire_torque = 60.0\ncan_id = 1\n[device."right/knee"]\ninvert = true\n'
        bus.rig.write_text(bus.rig.read_text() + device)
        robot = write(tmp_path, ROBOT.format(law="pass", torque=1.0, more="", blocks="", drive=PATIENT))
        options = ("--rig", bus.rig, "--yes", "--record", "out", "--duration", "0.3")
        refused = finished(robot, *options, cwd=tmp_path)
        assert refused.returncode == BAD_INPUT and "--accept left/knee.wire_torque" in refused.stderr
        bus.listen(0.2)
        assert not bus.commands(1), "a frame was sent to a drive that is not accepted"
        run = finished(robot, *options, "--accept", "left/knee.wire_torque", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    reason = f"wire_torque = 60 N·m ({bus.rig}), but 65 N·m in the table of AK10-9-V2.0"
    shown = " ".join((run.stdout + run.stderr).split())
    assert f"1 problem: left/knee: {reason}" in shown and "limit 18 N·m !; not read back: mode, " in shown
    assert f"limits left/knee: {reason}" in shown and "from lab.toml: invert true (diagram false)" in shown
    sidecar = Files(tmp_path / "out").sidecar
    [caveat] = sidecar["metadata"]["caveats"]
    assert caveat["path"] == "left/knee" and caveat["words"].startswith(reason)
    assert sidecar["metadata"]["accepted"] == ["left/knee.wire_torque"]
    [table] = [event for event in sidecar["events"] if event["event"] == "preflight"]
    assert table["devices"][0]["marks"]["limit"].startswith(reason) and "limit" not in table["devices"][1]["marks"]
