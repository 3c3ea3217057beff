"""Records of commissioning: readable files beside a rig, and when they apply."""

import datetime

import pytest

from blocks.actuators import CubeMars
from graph import Diagram
from runtime.host.errors import BadInput
from runtime.robot.rig import records
from runtime.robot.rig.records import Record, StepRecord, digest, records_of, settings_of, write


def knee(**parameters):
    with Diagram("robot", rate=200):
        return CubeMars("AK80-9", bus="legs", can_id=3, name="knee", **parameters)


def record(serial="A 1", **changed):
    found = [("direction", "reversed")]
    step = StepRecord("2026-12-01 14:02", records.DIFFERS, {"turned": -1.57}, ['says "so"'], found)
    signed = {"name": "E. Person", "date": "2026-12-01"}
    fields = {"device": "knee", "block": "CubeMars", "model": "AK80-9", "settings": settings_of(knee()), **changed}
    return Record(serial, signed=signed, steps={"turn": step}, **fields)


def test_a_record_is_read_as_it_was_written(tmp_path):
    rig = tmp_path / "lab.toml"
    path = write(rig, record())
    assert path == tmp_path / "lab.records" / "A_1.toml"
    found = records_of(rig)["knee"]
    assert found.text() == record().text() and found.findings == [["direction", "reversed"]]
    assert digest({"knee": found}) == digest({"knee": record()}) != digest({"knee": record(firmware="2")})


def test_the_newest_record_of_a_joint_counts(tmp_path):
    for serial, date in (("B", "2026-12-02"), ("A", "2026-12-03"), ("C", "2026-12-01")):
        unit = record(serial)
        unit.signed["date"] = date
        write(tmp_path / "lab.toml", unit)
    assert records_of(tmp_path / "lab.toml")["knee"].serial == "A"


@pytest.mark.parametrize(
    "block, days, reason",
    [
        ({}, 0, None),
        ({"can_id": 4}, 0, "was measured with can_id = 3"),
        ({"invert": True}, 0, "was measured with invert = false"),
        ({}, 181, "is 181 days old"),
    ],
)
def test_a_record_applies_while_unit_and_parameters_are_the_same_and_it_is_fresh(block, days, reason):
    with Diagram("robot", rate=200):
        joint = CubeMars("AK80-9", bus="legs", **{"can_id": 3, **block}, name="knee")
    today = datetime.date(2026, 12, 1) + datetime.timedelta(days)
    assert record().mismatches(joint, today) == ([reason] if reason else [])
    assert record(device="hip").mismatches(knee(), today)[0] == "was measured at hip"


def test_a_setting_that_was_added_later_voids_a_record_but_for_a_measured_range():
    def reasons(unit, **added):
        return unit.mismatches(knee(**added), datetime.date(2026, 12, 1))

    unit = record(settings={"can_id": 3})
    assert reasons(unit, wire_torque=36.0) == ["was measured without wire_torque = 36.0"]
    assert reasons(unit, range=(-1.0, 1.0)) == []


@pytest.mark.parametrize("text", ["version = 2\n", "version = 1\n", "no TOML"])
def test_another_file_is_refused(tmp_path, text):
    with pytest.raises(BadInput, match="is not a record of `commission`"):
        records.of_text(text, tmp_path / "x.toml")


@pytest.mark.hazard("H1o")
def test_a_declared_time_out_needs_a_silence_that_showed_it():
    with pytest.raises(ValueError, match="shorter than two ticks"):
        knee(drive_timeout=0.008).prepare(0.005)
    block, unit = knee(drive_timeout=0.1), record()
    unit.steps = {name: StepRecord("2026-12-01 14:02", records.AGREES) for name in records.BEFORE_TORQUE}
    assert unit.faults(knee()) == [] and not unit.mismatches(block, datetime.date(2026, 12, 1))
    missing = ["has no silence that shows drive_timeout = 0.1"]
    assert unit.faults(block) == missing
    for seconds, stopped, faults in ((0.3, 0.0, missing), (1.4, 1.0, missing), (0.3, 1.0, [])):
        measured = {"silence": seconds, "stopped": stopped}
        unit.steps["silence"] = StepRecord("2026-12-01 14:02", records.AGREES, measured)
        assert unit.faults(block) == faults, (seconds, stopped)


def test_check_shows_what_rests_on_a_record(tmp_path):
    from runtime.host.console.styles import Console
    from runtime.session.check.report import check
    from runtime.session.check.text import text

    rig = tmp_path / "lab.toml"
    rig.write_text('[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\n[device.knee]\nrange = [-2, 2]\n')
    robot = tmp_path / "robot.py"
    robot.write_text(
        "from blocks.actuators import CubeMars\nfrom graph import Diagram\nwith Diagram('knee', rate=200) as diagram:\n"
        "    CubeMars('AK80-9', bus='legs', can_id=3, name='knee')(torque_command=0.0)\n"
    )

    def shown():
        report = check(robot, rig=rig)
        return report["records"], "\n".join(text(report, Console(200)))

    assert "knee  no record: every number is that of a table" in shown()[1]
    unit = record(settings={"can_id": 3})
    unit.signed["date"] = f"{datetime.date.today()}"
    unit.steps["bus"] = StepRecord("2026-12-01 14:00", records.AGREES)
    write(rig, unit)
    (row,), words = shown()
    assert (row["serial"], row["agrees"], row["findings"], row["mismatches"]) == ("A 1", ["bus"], ["direction"], [])
    assert f"knee  A 1, E. Person, {datetime.date.today()}: bus; found: direction" in words
    robot.write_text(robot.read_text().replace("can_id=3", "can_id=4"))
    assert "knee  A 1 does not apply: it was measured with can_id = 3" in shown()[1]
