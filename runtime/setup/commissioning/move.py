"""Diagram of one actuator in slow motion, run by the command `move`.

    torque      ramp to the target, hold, ramp to zero; a limiter bounds its rate of change
    position    weak spring in the drive; its equilibrium moves from the current position to the target at a bounded
                speed
    velocity    damper in the drive; its velocity ramps to the target, holds, and ramps to zero

The actuator's limit bounds the sum of all terms of the drive's control law. A family may command its drives in other
ways (graph.family.Drive). The run ends if the velocity exceeds `fastest`, as that of a motor without load does.
"""

from blocks.families import families
from blocks.limiters import Saturation, TorqueLimiter
from blocks.logic import Compare, Or
from blocks.recorders import CsvRecorder
from blocks.safety import EmergencyStop
from blocks.sources import TimeTable
from graph import Block, Diagram, Input, Output, Param


class Approach(Block):
    """Ramp from the first input to the target at a bounded speed.

    NaN as first input passes and is held; the actuator then reports a fault.
    """

    target = Param(0.0, "rad", "final angle")
    speed = Param(0.5, "rad/s", "speed of the ramp", above=0.0)

    position = Input("rad", "joint angle")
    equilibrium = Output("rad", "angle on the ramp")

    def reset(self):
        self.now = None

    def step(self, position):
        if self.now is None:
            self.now = position
        else:
            step_limit = self.speed * self.dt
            self.now += min(max(self.target - self.now, -step_limit), step_limit)
        return self.now


def build(
    block: str = "",
    model: str = "",
    bus: str = "can",
    can_id: int = 1,
    kind: str = "torque",
    target: float = 0.0,
    limit: float = 1.0,
    duration: float = 5.0,
    rise: float = 1.0,
    speed: float = 0.5,
    stiffness: float = 1.0,
    damping: float = 0.1,
    fastest: float = 10.0,
    rate: float = 200.0,
    gear_ratio: float = 1.0,
) -> Diagram:
    """Return the Diagram.

    block : class name of the actuator block of a graph.family.Drive
    model : name of the drive's model in its family
    bus, can_id : name of the bus, and address of the drive
    kind : quantity of the target: torque (N·m), position (rad) or velocity (rad/s)
    target : value that is approached
    limit : N·m, bound of the torque
    duration, rise : s, of the run and of the ramp to the target
    speed : rad/s, of the motion to a position
    stiffness, damping : stiffness and damping of the drive's control law, N·m/rad and N·m·s/rad
    fastest : rad/s, velocity that ends the run
    rate : Hz
    gear_ratio : gear ratio of an additional gear between drive and joint
    """
    drive = next(drive for family in families() for drive in family.drives if drive.block.__name__ == block)
    with Diagram("move", rate=rate) as diagram:
        rise = min(rise, duration / 3.0)
        settings = {"bus": bus, "can_id": can_id, "limit": limit, "gear_ratio": gear_ratio, "name": "actuator"}
        if drive.settings is not None:
            settings |= drive.settings(kind, target, speed, rise)
        joint = drive.block(model, **settings)
        wave: dict = {"times": (0.0, rise, duration - rise, duration), "values": (0.0, target, target, 0.0)}
        if drive.wire is not None:
            drive.wire(joint, kind, target, wave)
        elif kind == "torque":
            joint(
                torque_command=TorqueLimiter(limit=limit, slew=2.0 * limit / rise)(
                    TimeTable(**wave, unit="N·m", name="target")()
                )
            )
        elif kind == "velocity":
            joint(velocity_command=TimeTable(**wave, unit="rad/s", name="target")(), damping_command=damping)
        else:
            reach = joint.command_limits()["position_command"].high
            way = Approach(target=target, speed=speed, name="target")(joint.position)
            joint(
                position_command=Saturation(lower=-reach, upper=reach)(way),
                stiffness_command=stiffness,
                damping_command=damping,
            )
        too_fast = Or()(Compare(">")(joint.velocity, fastest), Compare("<")(joint.velocity, -fastest))
        EmergencyStop(name="too_fast")(too_fast)
        CsvRecorder()
    return diagram
