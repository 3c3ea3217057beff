"""The test named for each measure of the safety case (H4, H5f) fails without the check behind it."""

from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import pytest

from tests.checkout import ROOT
from tests.mutation.laboratory import Laboratory

pytestmark = pytest.mark.soak


class Removed(NamedTuple):
    """A check that is removed. before, after : text of the file; modules : that are built anew; test : that fails"""

    file: str
    before: str
    after: str
    modules: tuple
    test: str


ARMING, DEVICES, BUSES = "cext/schedule/arming", "cext/schedule/devices", "cext/schedule/buses"
CHECKS = {
    "H4a: the operator's confirmation": Removed(
        "runtime/session/armed.py",
        '"confirm": table.confirm,',
        '"confirm": False,',
        (),
        "tests/runtime/robot/rig/test_preflight.py::test_torque_is_zero_until_operator_presses_enter",
    ),
    "H4b: a terminal": Removed(
        "runtime/session/prepare.py",
        "if not request.yes and request.arm_on is None and not can_ask():",
        "if False:",
        (),
        "tests/runtime/robot/rig/test_preflight.py::test_without_a_terminal_a_rig_is_refused_before_anything_is_sent",
    ),
    "H4c: enabling waits for the confirmation": Removed(
        f"{ARMING}.pyx",
        "cdef bint each = not looked and not self.control.devices.table.alone",
        "cdef bint each = True",
        (ARMING,),
        "tests/cext/schedule/test_enabling.py::test_nothing_is_enabled_or_commanded_before_the_operator_confirms",
    ),
    "H4c: a restart ends the run": Removed(
        f"{DEVICES}.pyx",
        "if self.may_have_restarted(device, now):",
        "if False:",
        (DEVICES,),
        "tests/blocks/actuators/test_restarts.py::test_a_drive_without_power_for_10_ms_has_no_torque_before_a_new_arming",
    ),
    "H4d: the fence, immediately before a send": Removed(
        f"{BUSES}.pyx",
        "if load_i32_in_order(&self.layout.fence) or fence_after_suspend(self.layout):",
        "if fence_after_suspend(self.layout):",
        (BUSES,),
        "tests/cext/safety/test_guarded.py::test_fence_raised_within_tick_blocks_its_frames",
    ),
    "H4d: a suspend, immediately before a send": Removed(
        f"{BUSES}.pyx",
        "if load_i32_in_order(&self.layout.fence) or fence_after_suspend(self.layout):",
        "if load_i32_in_order(&self.layout.fence):",
        (BUSES,),
        "tests/cext/safety/test_suspended.py::test_a_suspend_within_a_tick_ends_the_run_before_the_commands_of_that_tick_are_sent",
    ),
    "H4e: one controller": Removed(
        "runtime/robot/guardian/lock.py",
        "raise BusTaken(*owner)",
        "return",
        (),
        "tests/runtime/robot/guardian/test_lock.py::test_bus_has_one_controller_and_its_process_is_named",
    ),
    "H4f: the reason of a refusal": Removed(
        "runtime/host/machine/sleep.py",
        "return f\"systemd-inhibit: {lines[0].strip() or 'refused'}\"",
        'return ""',
        (),
        "tests/runtime/host/machine/test_sleep.py::test_a_refused_inhibitor_is_reported_with_its_reason",
    ),
    "H5f: two drives with one id": Removed(
        "cext/safety/twins.pxd",
        "return twins.surplus >= TWIN_REPLIES",
        "return False",
        (DEVICES,),
        "tests/cext/schedule/test_two_devices.py::test_a_second_drive_that_appears_in_a_run_ends_it",
    ),
    "H5f: two unique numbers": Removed(
        "cext/kernels/devices/robstride/private.pyx",
        "if unique[1] != high or unique[2] != low:",
        "if False:",
        ("cext/kernels/devices/robstride/private",),
        "tests/cext/schedule/test_two_devices.py::test_two_unique_numbers_behind_one_id_are_not_armed",
    ),
}


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory):
    return Laboratory(tmp_path_factory.mktemp("removed"))


@pytest.mark.parametrize("name", CHECKS)
def test_without_the_check_its_test_fails(laboratory, name):
    check = CHECKS[name]
    text = Path(ROOT, check.file).read_text()
    assert text.count(check.before) == 1
    target = SimpleNamespace(file=check.file, modules=check.modules, tests=(check.test,))
    # a busy machine may fail a test in real time, but not each time
    assert any(laboratory.passes(target.tests, 120.0, True) for _ in range(3)), laboratory.said
    for _ in range(2):
        assert laboratory.tried(target, SimpleNamespace(text=text.replace(check.before, check.after))) == "killed"
        assert "FAILED" in laboratory.said, laboratory.said
