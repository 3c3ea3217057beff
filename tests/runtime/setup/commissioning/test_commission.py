"""`commission` on emulated drives with faults: each is named before the drive gets torque, none on healthy ones."""

import math
import os
import re
import signal
import time

import pytest

from blocks import actuators as actuators_module
from graph import Diagram
from runtime.host.errors import BAD_INPUT
from runtime.robot.rig.records import AGREES, OPEN, Record, StepRecord, settings_of, write
from tests.runtime.runs import finished, knee
from tests.runtime.runs import write as write_file
from tests.runtime.setup.commissioning.benched import Benched
from tests.runtime.setup.commissioning.nodes import DISABLE, ENABLE, Mit, Node, Nodes

pytestmark = pytest.mark.paced


def ready(bench, name, kind="CubeMars", model="AK80-9"):
    """Write a record in which the steps before torque agree."""
    with Diagram("bench", rate=200):
        block = getattr(actuators_module, kind)(model, bus="legs", can_id=3, range=(-6.0, 6.0), name=name)
    steps = {step: StepRecord("2026-12-01 10:00", AGREES) for step in ("identity", "bus", "state", "turn")}
    record = Record(name, name, kind, model, settings=settings_of(block), steps=steps)
    record.signed = {"name": "E. Person", "date": time.strftime("%Y-%m-%d")}
    write(bench.rig, record)


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize(
    "end, step",
    [
        pytest.param("Ctrl-C", ["torque"], marks=pytest.mark.soak),
        ("kill -9", ["torque"]),
        pytest.param("hang-up", ["torque"], marks=pytest.mark.soak),
        ("Ctrl-C", ["home", "--toward", "lower", "--torque", "0.4"]),
        pytest.param("Ctrl-C", ["dynamics"], marks=pytest.mark.soak),
    ],
    ids=lambda value: value if isinstance(value, str) else value[0],
)
def test_a_step_under_torque_that_ends_early_leaves_the_drive_disabled(tmp_path, end, step):
    listener = Node()

    def finish(terminal):
        end = time.monotonic() + 10.0
        while bench.torque("knee") == 0.0 and time.monotonic() < end:
            time.sleep(0.02)
        if end == "Ctrl-C":
            terminal.press(b"\x03")
        else:
            os.kill(terminal.process.pid, signal.SIGKILL if end == "kill -9" else signal.SIGHUP)

    with Benched(tmp_path, 113, {"knee": ("CubeMars", "AK80-9", 3, {}, {})}) as bench:
        ready(bench, "knee")
        listener.start(bench.channel)
        code, shown = bench.commission("--only", *step, stop_at=(r"running 0\.", finish))
        time.sleep(0.5)
        listener.end()
        frames = [data for identifier, extended, data in listener.heard if identifier == 3 and data[0] != 3]
        assert ENABLE in frames, shown
        assert frames[-1] == DISABLE and ENABLE not in frames[frames.index(ENABLE) + 60 :]
        assert code not in (0, 1) and step[0] not in bench.records()["knee"].steps
        assert 0.0 < bench.torque("knee") <= 0.05 * 9.0


@pytest.mark.soak
def test_a_joint_is_homed_against_its_stop_and_its_offset_is_offered(tmp_path):
    with Benched(tmp_path, 120, {"knee": ("CubeMars", "AK80-9", 3, {}, {})}) as bench:
        ready(bench, "knee")
        home = ("--only", "home", "--toward", "lower", "--at", "-40", "--travel", "60")
        code, shown = bench.commission(*home)
        assert code == BAD_INPUT and "--torque" in shown
        code, shown = bench.commission(*home, "--torque", "2")
        assert code == BAD_INPUT and "at most 0.45 N·m" in shown
        bench.move({"knee": {"stop": -0.6, "inertia": 0.02}})
        code, shown = bench.commission(*home, "--torque", "0.4")
        step = bench.records()["knee"].steps["home"]
        assert code == 1 and [name for name, _ in step.findings] == ["zero"], shown
        assert step.measured["stop"] == pytest.approx(-0.6, abs=0.02)
        offered = float(re.search(r"offset = (\S+)", shown)[1])
        assert offered == pytest.approx(step.measured["stop"] + math.radians(40), abs=1e-3)
        assert 0.0 < bench.torque("knee") <= 0.4


@pytest.mark.soak
def test_a_time_out_that_the_operator_sets_in_a_cubemars_is_measured_again(tmp_path):
    with Benched(tmp_path, 125, {"knee": ("CubeMars", "AK80-9", 3, {}, {})}) as bench:
        ready(bench, "knee")
        bench.set_timeout = 0.1
        code, shown = bench.commission("--only", "silence")
        step = bench.records()["knee"].steps["silence"]
        assert code == 0 and "set_can_time_out 4000" in shown and "drive_timeout = 0.1" in shown, shown
        assert step.verdict == AGREES and step.measured["stopped"] == 1.0 and step.measured["silence"] < 0.4


@pytest.mark.hazard("H4i")
@pytest.mark.soak
@pytest.mark.parametrize("drive", [("CubeMars", "AK80-9"), ("CubeMarsServo", "AK60-6-V1.1"), ("RobStrideMIT", "RS04")])
def test_stops_are_measured_or_said_by_the_operator_or_not_done(tmp_path, drive):
    with Benched(tmp_path, 128, {"knee": (*drive, 3, {}, {})}) as bench:
        ready(bench, "knee", *drive)
        code, shown = bench.commission("--only", "stops")
        step = bench.records()["knee"].steps["stops"]
        assert code == 0 and step.verdict == AGREES and not step.findings, shown
        assert 0.0 < step.measured["ctrl_c"] < 0.2 and 0.0 < step.measured["kill"] < 0.2
        words = [line.partition(": ")[2] for line in step.says]
        for line, begin in zip(
            words, ("measured, ", "measured, ", "measured, ", "operator says: ", "not done"), strict=True
        ):
            assert line.startswith(begin), step.says
        assert "confirmed" not in " ".join(step.says) and 0.0 < bench.torque("knee")


@pytest.mark.soak
def test_a_supply_that_sags_under_5_percent_of_the_rated_torque_is_named(tmp_path):
    with Benched(tmp_path, 129, {"knee": ("CubeMars", "AK80-9", 3, {}, {})}) as bench:
        ready(bench, "knee")
        code, shown = bench.commission("--only", "supply")
        step = bench.records()["knee"].steps["supply"]
        assert code == 1 and [name for name, _ in step.findings] == ["sag of the supply"], shown
        assert step.measured["sag"] == pytest.approx(0.05) and 0.0 < bench.torque("knee") <= 0.05 * 9.0


@pytest.mark.soak
@pytest.mark.parametrize("chip", ["AS5600", "AS5047"])
@pytest.mark.parametrize("slip, offset, finding", [(0.0, 0.0, None), (0.1, 0.0, "slip"), (0.0, 0.4, "zero")])
def test_a_joint_is_compared_with_its_encoder(tmp_path, slip, offset, finding, chip):
    drives = {"knee": ("CubeMars", "AK80-9", 3, {"encoder": (chip, slip), "offset": offset}, {})}
    with Benched(tmp_path, 126, drives) as bench:
        code, shown = bench.commission("--only", "identity", "pose")
        step = bench.records()["knee"].steps["pose"]
        assert [name for name, _ in step.findings] == ([finding] if finding else []) and code == bool(finding), shown
        assert (f"offset = {offset}" in shown) == (finding == "zero")
        assert ('reference = "knee_encoder.position"' in shown) == (finding != "slip")


@pytest.mark.hazard("H4i")
def test_without_a_terminal_nothing_is_sent(tmp_path):
    drive = Mit(3)
    with Nodes(119, drive) as nodes:
        rig = write_file(
            tmp_path, f'[bus.legs]\ninterface = "udp_multicast"\nchannel = "{nodes.channel}"\n', "lab.toml"
        )
        process = finished("commission", rig, knee(tmp_path), "--name", "E. Person", cwd=tmp_path)
    assert process.returncode == BAD_INPUT and "run commission in a terminal" in process.stderr
    assert drive.heard == []


MIT = {  # {drive: ((block, model, id, faults of the emulator, parameters of the block), name of the finding)}
    "position": (("CubeMars", "AK80-9", 1, {"wire_position": 15.0}, {}), "position range"),
    "velocity": (("CubeMars", "AK80-9", 2, {"wire_velocity": 33.0}, {}), "velocity range"),
    "firmware": (("CubeMars", "AK40-10", 3, {"ranges": "manual"}, {}), "encoded ranges"),
    "reverse": (("CubeMars", "AK80-9", 4, {"invert": True}, {}), "direction"),
    "zero": (("CubeMars", "AK80-9", 5, {"offset": 0.4}, {}), "zero"),
    "output": (("CubeMars", "AK80-9", 6, {"wrap": 1.5}, {}), "wraps"),
    "gear": (("CubeMars", "AK80-9", 7, {"wrap": 0.698}, {}), "wraps"),
    "mask": (("CubeMars", "AK80-9", 8, {"errors": "mask", "inputs": {"temperature": 85.0}}, {}), "error semantics"),
    "code": (("CubeMars", "AK40-10", 9, {"errors": "code", "inputs": {"fault": 4}}, {}), "error semantics"),
    "fault": (("CubeMars", "AK80-9", 10, {"inputs": {"fault": 5}}, {}), "fault"),
    "stuck": (("CubeMars", "AK80-9", 11, {"inputs": {"stuck_encoder": True}}, {}), "encoder"),
    "mute": (("CubeMars", "AK80-9", 12, {"zero_silence": 1.0}, {"zero_at_arming": True}), "silent after zero"),
    "left": (("CubeMars", "AK80-9", 13, {"moved_by": "right"}, {}), "exchanged"),
    "right": (("CubeMars", "AK80-9", 14, {"moved_by": "left"}, {}), "exchanged"),
}
PROTOCOLS = {
    "servo": (("CubeMars", "AK80-9", 1, {"kind": "CubeMarsServo"}, {}), "protocol"),
    "private": (("CubeMars", "AK80-9", 2, {"kind": "RobStride", "other": "RS02"}, {}), "protocol"),
    "mit": (("RobStride", "RS02", 3, {"kind": "RobStrideMIT"}, {}), "protocol"),
    "newer": (("CubeMars", "AK80-9", 4, {"kind": "CubeMarsV3", "other": "AK80-9-V3.0"}, {}), "protocol"),
    "absent": (("CubeMars", "AK80-9", 5, {"absent": True}, {}), "silent"),
    "gone": (("CubeMars", "AK80-9", 6, {"absent": True}, {}), "part of a bus"),
    "twin": (("CubeMars", "AK80-9", 7, {"twin": True}, {}), "two drives with one id"),
    "half": (("CubeMars", "AK80-9", 8, {"inputs": {"dropped": 0.2}}, {}), "lost replies"),
    "slow": (("CubeMars", "AK80-9", 9, {"inputs": {"delay": 0.02}}, {}), "slow replies"),
    "noisy": (("CubeMars", "AK80-9", 10, {"noise": 0.05}, {}), "noisy position"),
    "ranges": (("RobStrideMIT", "RS04", 11, {"ranges": "private"}, {}), "encoded ranges"),
    "position": (("RobStride", "RS02", 12, {"wire_position": 13.1}, {}), "position range"),
    "velocity": (("RobStride", "RS02", 13, {"wire_velocity": 33.0}, {}), "velocity range"),
    "poles": (("CubeMarsServo", "AK60-6-V1.1", 14, {"pole_pairs": 21}, {}), "velocity range"),
    "board": (("CubeMarsV3", "AK80-9-V3.0", 15, {"wrap": 0.698}, {}), "wraps"),
    "cyber": (("RobStride", "CyberGear", 16, {"invert": True}, {}), "direction"),
}
OTHERS = {
    "older": (("CubeMarsV3", "AK80-9-V3.0", 1, {"kind": "CubeMarsServo", "other": "AK80-9"}, {}), "protocol"),
    "mit": (("CubeMarsServo", "AK80-9", 2, {"kind": "CubeMars"}, {}), "protocol"),
    "private": (("RobStrideMIT", "RS02", 3, {"kind": "RobStride"}, {}), "protocol"),
    "backwards": (("CubeMars", "AK80-9", 4, {"velocity": -1.0}, {}), "sign of velocity"),
    "restarted": (("CubeMars", "AK80-9", 5, {"turns": 1}, {}), "motor turn"),
    "turn": (("CubeMars", "AK80-9", 6, {"wrap": 6.2832}, {"offset": 3.0}), "wraps"),
    "far": (("RobStride", "RS02", 7, {"wrap": 6.2832, "end": 3.9}, {}), "wraps"),
    "gear": (("RobStride", "RS02", 8, {"gear_ratio": 1.5}, {}), "position range"),
    "slower": (("CubeMarsServo", "AK60-6-V1.1", 9, {"report_rate": 20.0}, {}), "report rate"),
    "unasked": (("CubeMarsV3", "AK80-9-V3.0", 10, {"report_rate": 100.0}, {}), "report rate"),
    "pair": (("CubeMarsServo", "AK80-9", 11, {"twin": True}, {}), "two drives with one id"),
    "couple": (("CubeMarsV3", "AK80-9-V3.0", 12, {"twin": True}, {}), "two drives with one id"),
    "brace": (("RobStride", "RS02", 13, {"twin": True}, {}), "two drives with one id"),
}
FURTHER = {
    "alternate": (("CubeMars", "AK80-9", 1, {"inputs": {"dropped": 0.5}}, {}), "lost replies"),
    "cyber": (("RobStride", "CyberGear", 2, {"velocity": -1.0}, {}), "sign of velocity"),
    "servo": (("CubeMarsServo", "AK60-6-V1.1", 3, {"velocity": -1.0}, {}), "sign of velocity"),
    "board": (("CubeMarsV3", "AK80-9-V3.0", 4, {"offset": 0.4}, {}), "zero"),
    "motor": (("RobStrideMIT", "RS04", 5, {"wrap": 0.698}, {}), "wraps"),
    "stuck": (("CubeMarsServo", "AK80-9", 6, {"inputs": {"stuck_encoder": True}}, {}), "encoder"),
    "shaken": (("CubeMarsV3", "AK80-9-V3.0", 7, {"noise": 0.05}, {}), "noisy position"),
    "slow": (("RobStride", "RS02", 8, {"inputs": {"delay": 0.02}}, {}), "slow replies"),
    "other": (("CubeMars", "AK80-9", 9, {"kind": "CubeMars", "other": "AK60-6-V1.1"}, {}), "velocity range"),
    "family": (("RobStrideMIT", "RS02", 10, {"kind": "CubeMars", "other": "AK80-9"}, {}), "protocol"),
    "healthy": (("RobStride", "RS04", 11, {}, {}), None),
}
TORQUE = {
    "against": (("CubeMars", "AK80-9", 4, {"torque_scale": -1.0}, {}), "sign of torque"),
    "declared": (("CubeMars", "AK80-9", 5, {}, {"drive_timeout": 0.1}), "no time-out"),
    "timeless": (("RobStride", "RS02", 6, {"ignores": ("canTimeout",)}, {}), "setting not kept"),
    "stiff": (("RobStrideMIT", "RS04", 10, {"wire_stiffness": 5000.0}, {}), "stiffness range"),
    "deaf": (("RobStride", "RS02", 7, {"timeout_scale": 1e9}, {}), "no time-out"),
    "late": (("RobStride", "RS02", 8, {"timeout_scale": 3.5}, {}), "late time-out"),
}
HEALTHY = {
    "mit": (("CubeMars", "AK80-9", 1, {}, {}), None),
    "timed": (("CubeMars", "AK80-9", 9, {"command_timeout": 0.1}, {"drive_timeout": 0.1}), None),
    "unread": (("CubeMarsServo", "AK60-6-V1.1", 10, {"command_timeout": 0.1}, {}), None),
    "mask": (("CubeMars", "AK40-10", 2, {}, {}), None),
    "servo": (("CubeMarsServo", "AK60-6-V1.1", 3, {}, {}), None),
    "board": (("CubeMarsV3", "AK80-9-V3.0", 4, {}, {}), None),
    "reports": (("CubeMarsV3", "AK80-9-V3.0", 8, {}, {"report_rate": 200.0}), None),
    "private": (("RobStride", "RS02", 5, {}, {}), None),
    "cyber": (("RobStride", "CyberGear", 6, {}, {}), None),
    "robstride": (("RobStrideMIT", "RS04", 7, {}, {}), None),
}
SUPPLY = {
    "low": (("RobStride", "RS02", 1, {"supply": 21.0}, {}), "supply voltage"),
    "high": (("RobStride", "CyberGear", 2, {"supply": 48.0}, {}), "supply voltage"),
    "private": (("RobStride", "RS02", 3, {}, {}), None),
    "cyber": (("RobStride", "CyberGear", 4, {}, {}), None),
    "mit": (("RobStrideMIT", "RS04", 5, {}, {}), None),
}
GROUND = {"ground": (("CubeMars", "AK80-9", 1, {"ground": True}, {}), "bus errors")}
PASSIVE = ("--only", "identity", "bus", "state", "zero", "pose", "turn", "motion")


@pytest.mark.soak
@pytest.mark.parametrize(
    "number, drives, words",
    [
        (114, MIT, PASSIVE),
        (115, PROTOCOLS, PASSIVE),
        (112, OTHERS, PASSIVE),
        (121, FURTHER, PASSIVE),
        (116, TORQUE, ()),
        (118, GROUND, PASSIVE),
        (116, SUPPLY, PASSIVE[:4]),
    ],
    ids=["MIT mode", "protocols and buses", "others", "further", "torque", "ground", "supply"],
)
def test_each_fault_is_named_before_5_percent_of_the_rated_torque(tmp_path, number, drives, words):
    check_what_is_found(tmp_path, number, drives, words, 1)


@pytest.mark.soak
@pytest.mark.parametrize("name", HEALTHY)
def test_no_fault_of_a_healthy_drive_is_invented(tmp_path, name):
    check_what_is_found(tmp_path, 117, {name: HEALTHY[name]}, (), 0)


def check_what_is_found(folder, number, drives, words, code):
    """Commission drives, and compare what was found with what was injected, None without a fault."""
    with Benched(folder, number, {name: spec for name, (spec, _) in drives.items()}) as bench:
        returned, shown = bench.commission(*words, timeout=500.0)
        records = bench.records()
        missed = {
            name: (wanted, records[name].findings if name in records else "no record")
            for name, (_, wanted) in drives.items()
            if name not in records or wanted not in ([found for found, _ in records[name].findings] or [None])
        }
        assert not missed, (missed, shown[-2000:])
        assert returned == code
        for name, ((block, model, *_), wanted) in drives.items():
            with Diagram("bench", rate=200):
                rated = getattr(actuators_module, block)(model, can_id=1, range=(-6.0, 6.0), name=name).spec.rated
            assert bench.torque(name) <= 0.05 * rated, name
            driven = not words and name != "timeless"
            assert (bench.torque(name) > 0.0) == driven, name
            if wanted is None:
                steps = {step: each.verdict for step, each in records[name].steps.items() if step != "zero"}
                assert steps == dict.fromkeys(steps, AGREES) | ({"law": OPEN} if block == "CubeMarsServo" else {})
