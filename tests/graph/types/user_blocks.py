"""Blocks of a user, whose stubs `python -m runtime stubs user_blocks` writes."""

from graph import Block, Input, Output, Param


class Elastic(Block):
    """Spring that is slack on one side: τ = -K max(θ, 0)."""

    stiffness = Param(30.0, "N·m/rad", "stiffness K", min=0.0, max=150.0, live=True)
    side = Param("left", "1", "side of the body", choices=("left", "right"))

    angle = Input("rad", "joint angle θ")
    torque = Output("N·m", 'torque of the "spring"')

    def step(self, angle):
        return -self.stiffness * max(angle, 0.0)


class Damped(Elastic):
    """The spring with a damper and a mass: τ = -K max(θ, 0) - m ω, with its power."""

    mass = Param(unit="kg", description="mass m", required=True)
    rest = Param(0.0, "rad", "angle at which it is slack")

    speed = Input("rad/s", "joint speed ω", default=0.0)
    power = Output("W", "power")

    def step(self, angle, speed):
        torque = -self.stiffness * max(angle - self.rest, 0.0) - self.mass * speed
        return torque, torque * speed
