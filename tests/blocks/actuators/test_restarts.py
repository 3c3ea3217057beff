"""A drive that restarts during a run, in every family: no torque until a new arming, even if nothing that it sent after
the restart arrived.
"""

import math

import numpy as np
import pytest

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, RobStride, RobStrideMIT
from tests.cext.imposed import imposed, still
from tests.cext.schedule.test_stop_values import PERIODIC, bursts, own, run
from tests.own_drives import FAMILIES as OWN
from tests.own_drives import OwnDrive
from tests.soaking import crossed, soaked

RATES = [100, 200, 500, 1000]
FAMILIES = {  # drive, model, parameters, the fault
    "CubeMars": (CubeMars, "AK80-9", {}, "not following"),
    "CubeMars V3.0": (CubeMarsV3, "AK80-9-V3.0", {}, "silent"),
    "CubeMars V3.0 with reports": (CubeMarsV3, "AK80-9-V3.0", {"report_rate": 500.0}, "silent"),
    "CubeMars in servo mode": (CubeMarsServo, "AK80-9", {"report_rate": 500.0}, "silent"),
    "CubeMars V3.0 in servo mode": (CubeMarsServo, "AK80-9-V3.0", {"report_rate": 0.0}, "silent"),
    "RobStride": (RobStride, "RS02", {}, "device fault"),
    "RobStride in MIT mode": (RobStrideMIT, "RS02", {}, "not following"),
}


def restarting(family, rate, commands=None, position=0.1, gone=0.01, unheard=0.006, **parameters):
    """A drive without power for `gone` s from 0.5 s on, of which nothing is received for `unheard` s more."""
    drive, model, more, _ = FAMILIES[family]
    if commands is None:
        commands = {"current_command": 4.0} if drive is CubeMarsServo else {"torque_command": 3.0}
    return imposed(
        still(position),
        drive=drive,
        model=model,
        rate=rate,
        substeps=10,
        seconds=1.5,
        commands=commands,
        emulator={
            "power_lost": lambda t: 0.5 - 1e-9 <= t < 0.5 + gone - 1e-9,
            "dropped": lambda t: float(0.5 - 1e-9 <= t < 0.5 + gone + unheard - 1e-9),
        },
        **more,
        **parameters,
    )


@pytest.mark.hazard("H4c")
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("family", FAMILIES)
def test_a_drive_without_power_for_10_ms_has_no_torque_before_a_new_arming(family, rate):
    """Its reports of the next 6 ms are lost, and with them that of its power-up."""
    rig, outcome = restarting(family, rate)
    assert (outcome.status, outcome.culprit) == (FAMILIES[family][3], "knee")
    before, after = rig.torques[rig.torques[:, 0] < 0.499], rig.torques[rig.torques[:, 0] > 0.5]
    assert np.abs(before[:, 1]).max() > 1.5 and not after[:, 1].any()


@pytest.mark.hazard("H4c")
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("family", [family for family in FAMILIES if "servo" not in family])
def test_a_restart_that_shifts_the_angle_ends_the_run(family, rate):
    """By two motor turns, in a joint that is held: the drive without an enable gives no torque, and the angle shows."""
    rig, outcome = restarting(
        family, rate, {"stiffness_command": 30.0, "position_command": 2.0 * math.pi / 4.5}, 4.0 * math.pi / 9, limit=6.0
    )
    assert outcome.status in (FAMILIES[family][3], "position jump") and outcome.tick / rate < 0.56
    assert not rig.torques[rig.torques[:, 0] > 0.5, 1].any()


@pytest.mark.parametrize("family", ["CubeMars V3.0", "CubeMars V3.0 with reports", "CubeMars in servo mode"])
def test_a_drive_that_was_measured_to_restart_slowly_may_be_silent_for_longer(family):
    rig, outcome = restarting(family, 200, gone=0.0, unheard=0.05, restart_time=0.3)
    assert outcome.status == "ok"


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("family", [family for family in FAMILIES if FAMILIES[family][3] == "silent"])
def test_a_single_lost_frame_is_no_restart(family, rate):
    drive, model, more, _ = FAMILIES[family]
    commands = {"current_command": 1.0} if drive is CubeMarsServo else {"torque_command": 1.0}
    _, outcome = imposed(
        still(),
        drive=drive,
        model=model,
        rate=rate,
        commands=commands,
        emulator={"dropped": lambda t: float(0.0 <= (t + 1e-6) % 0.1 < 0.5 / rate)},
        **more,
    )
    assert outcome.status == "ok"


class Interrupted(OwnDrive):
    """Without power from `off` for `gone` ns. It reports no power-up, and obeys the next command."""

    off, gone = 2_500_000_000, 0

    def hear(self, identifier, extended, data, now):
        if self.off <= now < self.off + self.gone:
            self.torque, self.enabled = 0.0, False
            return []
        return super().hear(identifier, extended, data, now)


@pytest.mark.hazard("H4c")
@pytest.mark.parametrize("gone", [0.016, 0.025, 0.040])
@pytest.mark.parametrize("transit", soaked([0.0, 0.008, 0.016, 0.030], but=[0, 3]))
@pytest.mark.parametrize("rate", [200, 500])
def test_a_constant_transit_hides_no_restart(rate, transit, gone):
    """Also after the transit was measured: the replies to the commands on their way are missing, too."""
    drive = Interrupted(OWN["v3"])
    drive.gone = round(gone * 1e9)
    outcome, _ = run("v3", [drive], ticks=3 * rate, rate=rate, wired={"transit": lambda: round(transit * 1e9)})
    assert outcome.status == "silent" and 2.3 < outcome.tick / rate < 2.7


@pytest.mark.parametrize("transit", [0.0, 0.008, 0.016, 0.030])
@pytest.mark.parametrize("rate", soaked([100, 200, 500, 1000], but=[1, 3]))
@pytest.mark.parametrize("name", PERIODIC)
def test_a_constant_transit_is_no_restart(name, rate, transit):
    late = {"transit": lambda: round(transit * 1e9)}
    outcome, _ = run(name, [own(name)], ticks=rate, rate=rate, wired=late, answered=int)
    assert (outcome.status, outcome.unconfirmed) == ("ok", ())


@pytest.mark.hazard("H4c")
@pytest.mark.parametrize("name, rate, burst", crossed(PERIODIC, [200, 500, 1000], [0.016, 0.020, 0.032, 0.048]))
def test_an_adapter_whose_bursts_could_hide_a_restart_is_refused_before_any_torque(name, rate, burst):
    for start in (0.0, 0.0023, 0.0121):
        drive = own(name)
        outcome, _ = run(name, [drive], rate=rate, block={"timeout": 0.2}, wired=bursts(burst, start), answered=int)
        assert (outcome.status, outcome.culprit, outcome.tick) == ("silent", "drive0", -1)
        assert all(kind != "command" for _, kind in drive.heard) and drive.torque == 0.0


@pytest.mark.parametrize("rate", [200, 500, 1000])
@pytest.mark.parametrize("name", PERIODIC)
def test_bursts_that_are_shorter_than_a_restart_are_permitted(name, rate):
    outcome, _ = run(name, [own(name)], ticks=rate, rate=rate, wired=bursts(0.008, 0.0023), answered=int)
    assert outcome.status == "ok"
