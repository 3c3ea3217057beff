"""What an actuator remembers of its last frame: the drive's whole law, decoded from its codes, at the joint in the
joint's direction.
"""

import pytest

from blocks.actuators import CubeMars, CubeMarsV3, RobStride, RobStrideMIT
from tests.blocks.actuators.wire import Wired

FIELDS = ("position", "velocity", "stiffness", "damping", "torque")
STEPS = {CubeMars: 4095, CubeMarsV3: 4095, RobStride: 65535, RobStrideMIT: 4095}  # codes of all but the position
DRIVES = [(CubeMars, "AK80-9"), (CubeMarsV3, "AK10-9 V3.0"), (RobStride, "RS03"), (RobStrideMIT, "RS03")]

drives = pytest.mark.parametrize("kind, model", DRIVES)
COMMAND = {"position": 0.3, "velocity": -1.5, "stiffness": 4.0, "damping": 0.4, "torque": 1.25}


def drive(kind, model, **parameters):
    wired = Wired(kind, model, **parameters)
    wired["position"], wired["velocity"], wired["age"] = 0.3, -1.5, 0.0
    wired.arena[3] = 0.001  # s, the period
    return wired


def assert_gains_and_torque(wired, gains, torque):
    """The sent law, to a code of a 12-bit field, or 16-bit."""
    shares = {"stiffness": gains, "damping": gains, "torque": torque}
    for place, (name, share) in enumerate(shares.items(), 2):
        assert wired["sent"][place] == pytest.approx(share * COMMAND[name], abs=2.001 * wired["wire"][place] / 4095), (
            name
        )


@drives
@pytest.mark.parametrize("parameters", [{}, {"invert": True, "offset": 0.7}, {"gear_ratio": 2.0}])
def test_the_law_of_the_last_frame_is_stored_at_the_joint(kind, model, parameters):
    wired = drive(kind, model, **parameters)
    assert wired["sent"].tolist() == [0.0] * 5, "nothing has been sent yet"
    wired.say(**{f"{name}_command": value for name, value in COMMAND.items()})
    for name, kept, half in zip(FIELDS, wired["sent"], wired["wire"]):
        code = (
            2.0 * half / 65535
            if name == "position"
            else (1.0 if name in ("stiffness", "damping") else 2.0) * half / STEPS[kind]
        )
        assert kept == pytest.approx(COMMAND[name], abs=1.001 * code), name
    assert wired["sent"][4] == wired["torque_sent"]


@drives
def test_fade_in_and_rejection_appear_in_the_stored_law(kind, model):
    wired = drive(kind, model)
    wired.arena[6] = 0.5
    wired.say(**{f"{name}_command": value for name, value in COMMAND.items()})
    assert_gains_and_torque(wired, 0.5, 0.5)
    before = wired["sent"].tolist()
    assert wired.say(torque_command=float("nan")) < 0 and wired["sent"].tolist() == before, "no frame, nothing new"


@drives
@pytest.mark.parametrize("allowed", [0.0, 0.5])
def test_a_lowered_share_of_gains_leaves_the_feed_forward_torque(kind, model, allowed):
    wired = drive(kind, model)
    wired["limits"] = [*wired["limits"][:6], allowed]
    wired.say(**{f"{name}_command": value for name, value in COMMAND.items()})
    assert_gains_and_torque(wired, allowed, 1.0)


def test_a_mode_without_the_law_sends_no_gains():
    wired = Wired(RobStride, "RS03", mode="current")
    wired.say(current_command=2.0)
    assert wired["sent"].tolist() == [0.0] * 5
