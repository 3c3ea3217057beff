"""Blocks of a user, whose stubs `python -m runtime stubs user_blocks` writes."""

from graph import Block, Input, Output, Param


class Elastic(Block):
    """Spring that is slack on one side: τ = -K max(θ, 0)."""

    stiffness = Param(30.0, "N·m/rad", "stiffness K", min=0.0, max=150.0, live=True)

    angle = Input("rad", "joint angle θ")
    torque = Output("N·m", 'torque of the "spring"')

    def step(self, angle):
        return -self.stiffness * max(angle, 0.0)
