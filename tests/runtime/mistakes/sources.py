"""Form of a mistake: the code of a diagram with it, the same code with the remedy applied, and the message.

The line of the mistake ends in `# !`, if the message names it.
"""

from dataclasses import dataclass

IMPORTS = """
from blocks.actuators import CubeMars
from blocks.controllers import Impedance
from blocks.filters import Butterworth
from blocks.limiters import SlewRate, TorqueLimiter
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from graph import Block, Diagram, Input, Output, Param, block, subsystem
"""
DRIVE = 'knee = CubeMars("AK10-9-V2.0", bus="legs", can_id=1, name="knee")'
LAW = f"""{DRIVE}
velocity = Butterworth(order=2, cutoff=20.0)(knee.velocity)
torque = Impedance(stiffness=30.0, damping=1.0)(position=knee.position, velocity=velocity)"""
COMMAND = "knee(torque_command=TorqueLimiter(limit=12.0)(torque))"
REST = "knee(torque_command=0.0)"
OWN = """class Own(Block):
    u = Input("any")
    y = Output("any")
"""


@dataclass(frozen=True)
class Mistake:
    """wrong, right : source of a diagram file; message : parts of the report, in their order"""

    name: str
    wrong: str
    right: str
    message: tuple[str, ...]


def diagram(body, before=""):
    """Return the source of a diagram file. body : of its `with` statement; before : lines above it"""
    indented = "".join(f"    {line}\n" for line in body.strip("\n").split("\n"))
    return f'{IMPORTS}{before}\nwith Diagram("knee", rate=200) as diagram:\n{indented}'


def in_drive(name, wrong, right, *message, before="", cure_before=None):
    """Mistake in a line of a diagram with an actuator at rest."""
    cure_before = before if cure_before is None else cure_before
    return Mistake(
        name, diagram(f"{DRIVE}\n{REST}\n{wrong}", before), diagram(f"{DRIVE}\n{REST}\n{right}", cure_before), message
    )


def in_command(name, wrong, right, *message):
    """Mistake in the command of an actuator."""
    return Mistake(name, diagram(f"{LAW}\n{wrong}"), diagram(f"{LAW}\n{right}"), message)


def in_block(name, wrong, right, *message, use="Own()(Sine()())"):
    """Mistake in the body of the class of a block."""
    indented = ["".join(f"    {line}\n" for line in text.split("\n")) for text in (wrong, right)]
    return Mistake(name, diagram(use, OWN + indented[0]), diagram(use, OWN + indented[1]), message)


def in_file(name, wrong, right, *message):
    """Mistake in a whole file, after the imports."""
    return Mistake(name, IMPORTS + wrong, IMPORTS + right, message)


def operation(name, wrong, right, block, before=""):
    """Operation that a signal does not support. block : the block that replaces it, in the line `right`"""
    return in_drive(
        name,
        f"{wrong}  # !",
        right,
        "knee.position is a signal, which has no value until the diagram runs: instead of ",
        block,
        before=before,
        cure_before=before,
    )


TWO_OUTPUTS = """class Own(Block):
    u = Input("1")
    a = Output("1")
    b = Output("1")
    def step(self, u):
        return u, u
"""
VECTOR = """import numpy
class Own(Block):
    u = Input("1")
    y = Output("1", shape=(3,))
    def step(self, u):
        return {}
"""
STEP = "def step(self, u):\n    return u"
STEP_INDENTED = STEP.replace("\n", "\n    ")
DIAGRAM = 'with Diagram("knee", rate=200) as diagram:\n    Sine()()\n'
BUILD = 'def build():  # !\n    with Diagram("knee", rate=200) as diagram:\n        Sine()()\n'
