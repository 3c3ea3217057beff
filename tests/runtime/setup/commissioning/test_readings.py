"""`commission` on emulated drives that report what cannot be: each reading is named before the drive gets torque."""

import pytest

from runtime.robot.rig.records import OPEN
from tests.runtime.setup.commissioning.benched import Benched
from tests.runtime.setup.commissioning.test_commission import PASSIVE, check_what_is_found

pytestmark = [pytest.mark.paced, pytest.mark.soak]

READINGS = {  # {drive: ((block, model, id, faults of the emulator, parameters of the block), name of the finding)}
    "dead": (("CubeMars", "AK80-9", 1, {"velocity": 0.0}, {}), "no velocity"),
    "motor": (("CubeMars", "AK80-9", 2, {"velocity": 9.0}, {}), "velocity range"),
    "frozen": (("CubeMars", "AK80-9", 3, {"position": 0.0}, {}), "encoder"),
    "crept": (("CubeMars", "AK80-9", 4, {"bias": 0.5}, {}), "velocity at rest"),
    "cold": (("CubeMars", "AK80-9", 5, {"inputs": {"temperature": -40.0}}, {}), "temperature"),
    "hot": (("RobStride", "RS02", 6, {"inputs": {"temperature": 95.0}}, {}), "temperature"),
    "plug": (("RobStride", "RS02", 7, {"plug": 0.15}, {}), "lost replies"),
    "servo": (("CubeMarsServo", "AKA60-6", 8, {"position": 0.0}, {}), "encoder"),
    "often": (("CubeMarsServo", "AK60-6-V1.1", 9, {"report_rate": 100.0}, {"report_rate": 50.0}), "report rate"),
    "board": (("CubeMarsV3", "AK80-9-V3.0", 10, {"bias": 0.5}, {}), "velocity at rest"),
    "against": (("RobStride", "CyberGear", 11, {"position": -1.0}, {}), "sign of velocity"),
}


@pytest.mark.hazard("H4i")
def test_a_reading_that_cannot_be_is_named_before_torque(tmp_path):
    check_what_is_found(tmp_path, 110, READINGS, PASSIVE, 1)


def test_a_drive_that_reports_a_torque_without_a_command_gets_none(tmp_path):
    stray = {"knee": ("CubeMars", "AK80-9", 3, {"inputs": {"stray_torque": 0.4}}, {})}
    with Benched(tmp_path, 111, stray) as bench:
        code, shown = bench.commission()
        assert code == 1 and "because of what was found: torque at rest" in shown and "to arm" not in shown


def test_a_healthy_drive_with_friction_agrees(tmp_path):
    check_what_is_found(tmp_path, 112, {"knee": (("CubeMars", "AK80-9", 3, {"friction": 0.045}, {}), None)}, (), 0)


def test_friction_that_hides_the_torque_is_no_finding(tmp_path):
    with Benched(tmp_path, 113, {"knee": ("CubeMars", "AK80-9", 3, {"friction": 0.25}, {})}) as bench:
        code, shown = bench.commission()
        steps = bench.records()["knee"].steps
        assert code == 0 and not bench.records()["knee"].findings, shown[-2000:]
        assert {name: steps[name].verdict for name in ("torque", "law", "silence")} == dict.fromkeys(
            ("torque", "law", "silence"), OPEN
        )
        assert "friction" in " ".join(steps["torque"].says)
