"""As many drives as a schedule may have: each is commanded, taken out and reported under its own number."""

import pytest

from blocks.actuators import CubeMars
from cext.bus.memory_bus import MemoryBus
from cext.memory.shared_state import SharedState
from cext.schedule.program import Program
from graph import Block, Diagram, Output, compile
from tests.blocks.actuators import reference
from tests.cext.rigs import Rig

LIMIT, ON_A_BUS, RATE = 1024, 32, 50
OUT = (0, 63, 64, 65, 127, 128, 1023)
SILENT = 65


class Drives(Block):
    """In the plant: drives that answer every frame, on all buses. silent : number of one that falls silent at 0.2 s"""

    y = Output("1")

    def __init__(self, silent=None, **options):
        self.ends, self.silent, self.limits = [], silent, reference.ranges(velocity=50.0, torque=18.0)
        super().__init__(**options)

    def step(self, t):
        for bus, end in enumerate(self.ends):
            for identifier, _, _, _ in end.receive():
                if bus * ON_A_BUS + identifier - 1 != self.silent or t < 0.2:
                    reply = reference.reply(self.limits, identifier, 0.0, 0.0, 0.0, 25, 0)
                    end.send(identifier, reply, False, round(t * 1e9))
        return 0.0


def robot_with(count, out=()):
    with Diagram("robot", rate=RATE) as robot:
        for number in range(count):
            bus, place = divmod(number, ON_A_BUS)
            CubeMars(
                "AK80-9",
                can_id=place + 1,
                bus=f"bus{bus:02}",
                name=f"drive{number:04}",
                disabled=number in out,
                timeout=0.1,
            )(torque_command=0.5)
    return robot


def run(ticks, out=(), silent=None):
    with Diagram("plant", rate=RATE) as plant:
        drives = Drives(silent)
    rig = Rig(robot_with(LIMIT, out), plant, shared=1 << 26, record=False)
    assert [device.name for device in rig.schedule.devices] == [f"drive{number:04}" for number in range(LIMIT)]
    drives.ends = [bus.device for bus in rig.buses.values()]
    return rig, rig.executor.run(ticks, fade=0.0)


def test_one_drive_more_is_refused():
    schedule = compile(robot_with(LIMIT + 1))
    with pytest.raises(ValueError, match=r"at most 1024 devices in a diagram, not 1025"):
        Program(schedule, [MemoryBus().host for _ in schedule.buses])


@pytest.mark.soak
def test_drives_that_are_taken_out_are_shown_under_their_numbers():
    rig, outcome = run(4, OUT)
    assert (outcome.status, outcome.unconfirmed) == ("ok", ())
    assert rig.shared.out == sum(1 << number for number in OUT)
    assert SharedState(fd=rig.shared.fd).out == rig.shared.out, "and so the guardian sees them"


def test_a_drive_that_falls_silent_is_named():
    _, outcome = run(20, silent=SILENT)
    assert (outcome.status, outcome.culprit, outcome.unconfirmed) == ("silent", "drive0065", ("drive0065",))
