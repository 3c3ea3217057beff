"""Numbers that leave the range of an integer, in what devices send: clamped, on every processor."""

import math
import struct

import pytest

from blocks.actuators import EmulatedCubeMars, EmulatedRobStride
from blocks.controls import EmulatedControls
from tests.blocks.actuators.wire import Wired
from tests.cext.rigs import one_drive

EVENT = struct.Struct("<qqHHi")


@pytest.mark.parametrize(
    "value, sent", [(1e30, 2**31 - 1), (-1e30, -(2**31)), (1.0, 255), (-1.0, -255), (1e300, 2**31 - 1)]
)
def test_an_axis_beyond_its_range_goes_to_its_own_end(value, sent):
    """Unclamped, 1e30 is full left on x86-64 and full right on aarch64."""
    pad = Wired(EmulatedControls, axes=(("x", 0, -255, 255),))
    [(_, data)] = pad.say(x=value)
    assert EVENT.unpack(data)[4] == sent


@pytest.mark.parametrize("device, model", [(EmulatedCubeMars, "AK80-9"), (EmulatedRobStride, "RS03")])
@pytest.mark.parametrize("name", ["fault", "wrong_id"])
@pytest.mark.parametrize("value", [-1.0, 300.0, 4294967296.0, 1e30, -1e30])
def test_an_emulated_drive_survives_any_number_at_its_inputs(device, model, name, value):
    drive = Wired(device, model)
    if name in drive.block.inputs:
        assert isinstance(drive.say(**{name: value}), list)


def test_a_safe_stop_without_a_time_limit_lasts_until_it_is_confirmed():
    """An infinite limit, as an integer, was the smallest one on x86-64, so that the stop ended after one round."""
    rig = one_drive(lambda knee: 0.0)
    outcome = rig.run(20, stopping_timeout=math.inf)
    assert (outcome.status, outcome.unconfirmed) == ("ok", ())
