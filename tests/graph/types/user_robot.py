"""A robot whose author makes mistakes: type checkers report the lines that end in `# wrong`, and no other."""

from user_blocks import Damped, Elastic

from blocks.actuators import CubeMars
from blocks.controllers import PID, GaitPhase, Impedance
from blocks.filters import Butterworth
from blocks.limiters import TorqueLimiter
from blocks.mathematics import Sum
from blocks.states import StateMachine
from graph import Block, Diagram, Input, Live, Output, Param, stack, subsystem
from runtime import connect, load, run


class Spring(Block):
    """Virtual spring: τ = -K θ."""

    stiffness = Param(30.0, "N·m/rad", "stiffness", min=0.0, max=150.0, live=True)
    steps = Param(3, "1", "number of steps")
    side = Param("left", "1", "side of the body")

    angle = Input("rad")
    torque = Output("N·m")

    def step(self, angle: float) -> float:
        label: str = self.stiffness  # wrong: a number
        steps: int = self.steps
        print(self.side.upper(), label)
        return -self.stiffness * angle * steps - self.side  # wrong: text


with Diagram("robot", rate=200) as diagram:
    with subsystem("left", every=2):
        knee = CubeMars("AK80-9", bus="left", can_id=1, limit=12.0, offset="10 deg", name="knee")
    phase, walking, *_ = GaitPhase(threshold=0.5)(knee.position, knee.velocity)
    law = Impedance(stiffness=Live(20.0, max=40.0), damping=1)
    Impedance(stifness=3)  # wrong: misspelt parameter
    Impedance(stiffness="3")  # wrong: a text for a number
    torque = law(knee.position, velocity=knee.velocity)
    value: float = law.stiffness + 1.0
    law.stiffness = knee.position  # wrong: a signal for a number
    law(knee.positoin)  # wrong: misspelt output
    law(knee.position, speed=knee.velocity)  # wrong: no such input
    PID(kp=2.0)(0.5, measurment=knee.position)  # wrong: no such input
    law(knee.position, velocity="fast")  # wrong: neither a signal nor a number
    total = 2.0 * torque - knee.torque / 3 + Sum("+-")(torque, knee.torque)
    torque + "1"  # wrong: a signal and a text
    torque * None  # wrong: a signal and nothing
    total.pth  # wrong: no attribute of a signal
    Butterworth(2, 10.0, "lowpas")(total)  # wrong: none of the choices
    TorqueLimiter()(total)  # wrong: limit is required
    phase, walking = GaitPhase()(knee.position, knee.velocity)  # wrong: four outputs
    GaitPhase()(knee.position, knee.velocity).phse  # wrong: misspelt output of a result
    elastic = Elastic(stiffness=3.0)
    Elastic(stifness=3.0)  # wrong: misspelt parameter of an own block
    elastic(knee.positoin)  # wrong: misspelt output
    elastic(angel=knee.position).to("N·m")  # wrong: misspelt input of an own block
    Elastic(stiffness=[3.0])  # wrong: a list for a number
    Elastic(side="middle")  # wrong: none of the choices
    Damped(rest=0.1)  # wrong: mass is required
    Damped(mass=2.0, nme="knee")  # wrong: misspelt option
    damped = Damped(mass=2.0, stiffness=40.0, every=2)
    damped(knee.position, knee.velocity, 3.0)  # wrong: two inputs
    damped(angle=knee)  # wrong: a block for a signal
    damped.stifness  # wrong: misspelt parameter of a base class
    torque, power, rest = damped(knee.position)  # wrong: two outputs
    damped(knee.position).powr  # wrong: misspelt output of a result
    knee(torque_command=damped(knee.position))  # wrong: two outputs for a signal
    if knee.position > 1.0:  # wrong: a signal as a condition
        print(damped.torque.to("N·m"), damped.power)
    spring = Spring(stiffness=3.0)
    spring(knee.position.to("deg"))
    machine = StateMachine(gives={"level": "1"}, states={"rest": {"level": 1.0}})
    both = stack(spring.torque, phase * walking)[0]
    knee(torque_command=TorqueLimiter(limit=5.0)(both + machine.level))
    print(f"{diagram.name}: {diagram['left/knee'].path}, {len(diagram)} blocks, {value}")

trial = run(diagram, duration=1.0, settings={"left/knee.limit": 10.0}, seed=1)
print(trial["left/knee.position"].max(), trial.time[-1], trial.fault, load("a.mcap").unit("left/knee.position"))
trial.tme  # wrong: no attribute of a trial
load("a.mcap").tme  # wrong: no attribute of a trial
print(load(["a.mcap", "b.mcap"]).labels)
run(diagram, duration="1")  # wrong: a text for a number
run("robot.py", fast=False, recrd="trials")  # wrong: misspelt option
connect("robot.py", yes=True, stop_for=1.0, subjct="S03")  # wrong: misspelt option
