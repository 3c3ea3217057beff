"""Mistakes of a diagram's author: the code with its mistake, the same code with the remedy applied, and the message.

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

OPERATIONS = (
    operation(
        "numpy function",
        "np.sin(knee.position)",
        "from blocks.trigonometry import Sin; Sin()(knee.position)",
        "numpy.sin, use Sin (from blocks.trigonometry)",
        "import numpy as np\n",
    ),
    operation(
        "numpy clip",
        "np.clip(knee.position, -1, 1)",
        "from blocks.limiters import Saturation; Saturation(-1.0, 1.0)(knee.position)",
        "numpy.clip, use Saturation (from blocks.limiters)",
        "import numpy as np\n",
    ),
    operation(
        "numpy array",
        "np.array([knee.position, 0.0])",
        "from graph import stack; stack(knee.position, 0.0)",
        "numpy.array(), combine signals with stack(a, b, c) (from graph)",
        "import numpy as np\n",
    ),
    operation(
        "math function",
        "math.sqrt(knee.position)",
        "from blocks.mathematics import SquareRoot; SquareRoot()(knee.position)",
        "a function of math, use a block such as Sin or SquareRoot",
        "import math\n",
    ),
    operation(
        "max",
        "max(knee.position, 0)",
        "from blocks.mathematics import Max; Max()(knee.position, 0.0)",
        "for max() and min() use Max and Min (from blocks.mathematics)",
    ),
    operation(
        "abs",
        "abs(knee.position)",
        "from blocks.mathematics import Abs; Abs()(knee.position)",
        "abs(), use Abs (from blocks.mathematics)",
    ),
    operation(
        "comparison in if",
        "x = 1.0 if knee.position > 0.5 else 0.0",
        'from blocks.logic import Compare, Switch; Switch()(Compare(">")(knee.position, 0.5), 1.0, 0.0)',
        '>, compare with Compare(">")(a, b), and choose with Switch (both from blocks.logic)',
    ),
    operation(
        "equality",
        "x = knee.position == 0",
        'from blocks.logic import Compare; Compare("==")(knee.position, 0.0)',
        '== or != with a number, use Compare("==") or Compare("!=") (from blocks.logic)',
    ),
    operation(
        "truth of a signal",
        "x = knee.position and 1.0",
        'from blocks.logic import And, Compare; And()(Compare(">")(knee.position, 0.0), 1)',
        "if, and, or, not or bool(), use Switch, And, Or, Not (from blocks.logic)",
    ),
    operation(
        "power",
        "x = knee.position ** 2",
        "from blocks.mathematics import Power; Power(2.0)(knee.position)",
        "**, use Power (from blocks.mathematics)",
    ),
    operation(
        "rounding",
        "x = round(knee.position)",
        "from blocks.mathematics import Round; Round()(knee.position)",
        "round(), use Round (from blocks.mathematics)",
    ),
    operation(
        "modulo",
        "x = knee.position % 1.0",
        "@block\ndef wrap(u: Input('any')) -> Output('any'):\n    return u % 1.0\nwrap()(knee.position)",
        "%, write a block, with @block (from graph)",
    ),
    operation(
        "printed value",
        'print(f"{knee.position:.2f}")',
        'print(f"{knee.position}", end="")',
        "the format '.2f', connect a recorder and read the recording after the run",
    ),
    operation(
        "loop over a signal",
        "x = [element for element in knee.position]",
        "from graph import stack; x = stack(knee.position, 0.0)[0]",
        "iterating, select elements with an index",
    ),
    in_drive(
        "index of a scalar",
        "x = knee.position[0]  # !",
        "x = knee.position",
        "knee.position is a scalar, which has no elements",
    ),
    in_drive(
        "call of a signal",
        "x = knee.position()  # !",
        "x = knee.position",
        "'Signal' object is not callable; omit the parentheses",
    ),
    in_drive(
        "attribute of a signal",
        "x = knee.position.value  # !",
        "x = knee.position",
        "'Signal' object has no attribute 'value'; a signal has arithmetic, an index and .to(unit)",
    ),
)

IMPORTS_AND_NAMES = (
    Mistake(
        "relative import",
        "from .wearer import plant  # !\n" + diagram("Sine()()"),
        diagram("Sine()()"),
        ("the file is not in a package: omit the dot, as in `from wearer import plant`",),
    ),
    Mistake(
        "block not imported",
        diagram(f"{LAW}  # !\n{COMMAND}").replace("from blocks.controllers import Impedance\n", ""),
        diagram(f"{LAW}\n{COMMAND}"),
        ("name 'Impedance' is not defined; add the line `from blocks.controllers import Impedance`",),
    ),
    Mistake(
        "Diagram not imported",
        f"from blocks.sources import Sine\n{DIAGRAM}".replace("diagram:", "diagram:  # !"),
        f"from blocks.sources import Sine\nfrom graph import Diagram\n{DIAGRAM}",
        ("name 'Diagram' is not defined; add the line `from graph import Diagram`",),
    ),
    in_drive(
        "numpy not imported", "x = np.pi  # !", "import numpy as np; x = np.pi", "add the line `import numpy as np`"
    ),
    in_drive("module not imported", "x = math.pi  # !", "import math; x = math.pi", "add the line `import math`"),
    in_drive(
        "misspelt variable",
        "x = kne.position  # !",
        "x = knee.position",
        "name 'kne' is not defined; did you mean 'knee'?",
    ),
    in_file(
        "block from the wrong module",
        f"from blocks import Notch  # !\n{DIAGRAM}",
        f"from blocks.filters import Notch\n{DIAGRAM}",
        "it is in another module: write `from blocks.filters import Notch`",
    ),
    in_file(
        "misspelt block",
        f"from blocks.filters import Noch  # !\n{DIAGRAM}",
        f"from blocks.filters import Notch\n{DIAGRAM}",
        "cannot import name 'Noch'",
        "did you mean 'Notch'?",
    ),
    in_file(
        "misspelt module",
        f"from blocks.filter import Notch  # !\n{DIAGRAM}",
        f"from blocks.filters import Notch\n{DIAGRAM}",
        "No module named 'blocks.filter'; did you mean 'blocks.filters'?",
    ),
    in_file(
        "name of the distribution",
        f"from tickwork import Diagram  # !\n{DIAGRAM}",
        f"from graph import Diagram\n{DIAGRAM}",
        "import from the packages graph, blocks and runtime, as in `from graph import Diagram`",
    ),
    in_file("library not installed", f"import no_such_library  # !\n{DIAGRAM}", DIAGRAM, "pip install no-such-library"),
)

WIRES = (
    in_command(
        "input assigned",
        "knee.torque_command = TorqueLimiter(limit=12.0)(torque)  # !",
        COMMAND,
        "knee.torque_command: an assignment does not connect the input",
        "call the block, as in knee(torque_command=...)",
    ),
    in_command(
        "misspelt input assigned",
        "knee.torqe_command = TorqueLimiter(limit=12.0)(torque)",
        COMMAND,
        "none of its commands is connected",
        "'torqe_command' is not connected: call the block, as in knee(torque_command=...)",
    ),
    in_command(
        "limiter above the rated torque",
        "knee(torque_command=TorqueLimiter(limit=25.0)(torque))  # !",
        "knee(torque_command=TorqueLimiter(limit=18.0)(torque))",
        "torque_limiter.limited can reach [-25, 25] N·m, and the limit is [-18, 18] N·m",
        'lower the limit of torque_limiter to 18, or pass limit="peak" to knee for 48 N·m',
    ),
    in_command(
        "limiter above the peak torque",
        "knee(torque_command=TorqueLimiter(limit=60.0)(torque))  # !",
        "knee(torque_command=TorqueLimiter(limit=18.0)(torque))",
        "lower the limit of torque_limiter to 18",
    ),
    in_command(
        "gain after the limiter",
        "knee(torque_command=2.0 * TorqueLimiter(limit=12.0)(torque))  # !",
        "knee(torque_command=TorqueLimiter(limit=18.0)(2.0 * torque))",
        "gain.y can reach [-24, 24] N·m",
        "put a limiter last, as in knee(torque_command=TorqueLimiter(limit=18)(...))",
    ),
    in_command(
        "constant above the limit",
        "knee(torque_command=100.0)  # !",
        "knee(torque_command=10.0)",
        "100 N·m is commanded, and the limit is [-18, 18] N·m",
        "command a value from -18 to 18 N·m",
    ),
    in_command(
        "signal as parameter",
        "knee(torque_command=TorqueLimiter(torque, limit=12.0))  # !",
        COMMAND,
        "the signal impedance.torque was passed as a parameter",
        "pass parameters to the class and signals to the block, as in TorqueLimiter(...)(signal)",
    ),
    in_drive(
        "inputs in the first parentheses",
        "Impedance(position=knee.position, velocity=knee.velocity)  # !",
        "Impedance()(position=knee.position, velocity=knee.velocity)",
        "has no parameter 'position'",
        "as in Impedance(...)(position=...)",
    ),
    in_drive(
        "parameter in the second parentheses",
        "Impedance()(position=0.0, velocity=0.0, stiffness=3.0)  # !",
        "Impedance(stiffness=3.0)(position=0.0, velocity=0.0)",
        "has no input 'stiffness'",
        "stiffness is a parameter: pass it to the class, as in Impedance(stiffness=...)",
    ),
    in_command(
        "block without its call",
        "knee(torque_command=TorqueLimiter(limit=12.0))  # !",
        COMMAND,
        "is neither a signal nor a number",
        "call the block to get its output, as in TorqueLimiter(...)(torque)",
    ),
    in_drive(
        "block as a signal",
        "Butterworth(2, 20.0)(knee)  # !",
        "Butterworth(2, 20.0)(knee.velocity)",
        "<CubeMars knee> is neither a signal nor a number",
        "choose an output of knee: position, velocity, torque",
    ),
    in_drive(
        "class as a signal",
        "Butterworth(2, 20.0)(Sine)  # !",
        "Butterworth(2, 20.0)(Sine()())",
        "is neither a signal nor a number",
        "make a block and call it, as in Sine(...)()",
    ),
    in_drive(
        "arithmetic with a block",
        "x = 2.0 * Sine()  # !",
        "x = 2.0 * Sine()()",
        "call the block to get its output, as in Sine(...)()",
    ),
    in_drive(
        "input as a signal",
        "Butterworth(2, 20.0)(knee.torque_command)  # !",
        "Butterworth(2, 20.0)(knee.torque)",
        "is neither a signal nor a number",
        "torque_command is an input: connect an output",
    ),
    in_drive(
        "list of signals",
        "Butterworth(2, 20.0)([knee.velocity, knee.velocity])  # !",
        "from graph import stack; Butterworth(2, 20.0)(stack(knee.velocity, knee.velocity))",
        "is neither a signal nor a number",
        "combine signals with stack(a, b, c) (from graph)",
    ),
    in_drive(
        "list of recorded signals",
        "CsvRecorder()([knee.position, knee.velocity])  # !",
        "CsvRecorder()(knee.position, knee.velocity)",
        "pass the signals one by one, as in block(a, b)",
    ),
    in_drive(
        "file name of a recorder",
        'CsvRecorder("out.csv")  # !',
        "CsvRecorder()",
        "there is no signal 'out.csv'",
        "--record sets the folder",
    ),
    in_drive(
        "misspelt output",
        "x = knee.velocty  # !",
        "x = knee.velocity",
        "no attribute 'velocty'; did you mean 'velocity'?",
    ),
    in_drive(
        "several outputs",
        "Butterworth(2, 20.0)(Own()(1.0))  # !",
        "Butterworth(2, 20.0)(Own()(1.0).a)",
        "expected one signal, got 2 (a, b)",
        "choose one by name",
        before=TWO_OUTPUTS,
    ),
    in_drive(
        "too many signals",
        "Butterworth(2, 20.0)(knee.velocity, knee.torque)  # !",
        "Butterworth(2, 20.0)(knee.velocity)",
        "has 1 input (u), got 2 signals",
    ),
    in_drive(
        "input not connected",
        "Impedance()(position=knee.position)",
        "Impedance()(position=knee.position, velocity=0.0)",
        "impedance.velocity: the input is not connected and has no default [rad/s]",
    ),
    in_drive(
        "input connected twice", "knee(torque_command=1.0)  # !", "x = 1.0", "knee.torque_command: is already wired at"
    ),
    Mistake(
        "actuator without a command",
        diagram(f"{DRIVE}  # !"),
        diagram(f"{DRIVE}\n{REST}"),
        ("none of its commands is connected",),
    ),
    in_drive(
        "loop",
        "a = Butterworth(2, 20.0)\na(2.0 * a.y)  # !",
        "from blocks.discrete import UnitDelay\na = Butterworth(2, 20.0)\na(2.0 * UnitDelay()(a.y))",
        "these blocks depend on each other in the same tick",
        "insert a block without direct feedthrough, such as UnitDelay",
    ),
    in_drive(
        "degrees",
        "Impedance()(position=Sine(30.0, unit='deg')(), velocity=0.0)  # !",
        "Impedance()(position=Sine(30.0, unit='deg')().to('rad'), velocity=0.0)",
        "expected rad, got deg from sine.y",
        "connect signal.to('rad')",
    ),
    in_drive(
        "number in degrees",
        "knee(position_command=30, stiffness_command=1.0)  # !",
        "from graph import deg; knee(position_command=deg(30), stiffness_command=1.0)",
        "30 rad",
        "did you mean deg(30)?",
    ),
    in_drive(
        "sum of different units",
        "x = knee.position + knee.velocity  # !",
        "x = knee.position + knee.position",
        "expected rad, got rad/s",
    ),
    in_file(
        "signal of another diagram",
        f"{DIAGRAM}    x = Sine()()\nwith Diagram('b', rate=100) as diagram:\n    Butterworth(2, 20.0)(x)  # !\n",
        "with Diagram('b', rate=100) as diagram:\n    Butterworth(2, 20.0)(Sine()())\n",
        "comes from a block that is not in this diagram",
    ),
    in_command(
        "factor without a unit",
        "knee(torque_command=TorqueLimiter(limit=12.0)(-30.0 * knee.position))  # !",
        "from blocks.mathematics import Gain; "
        'knee(torque_command=TorqueLimiter(limit=12.0)(Gain(-30, unit="N·m/rad")(knee.position)))',
        "expected N·m, got rad from gain.y",
        'give the factor its unit, as in Gain(-30, unit="N·m/rad")(signal)',
    ),
    Mistake(
        "output as a command",
        diagram(f"{DRIVE}\nknee(torque=1.0)  # !"),
        diagram(f"{DRIVE}\nknee(torque_command=1.0)"),
        ("knee: has no input 'torque'", "did you mean 'torque_command'?"),
    ),
    in_drive(
        "method for a command",
        "knee.set_torque(1.0)  # !",
        "x = 1.0",
        "no attribute 'set_torque'; call the block to command it, as in knee(torque_command=...)",
    ),
    in_drive(
        "signal in a step",
        "Own()(1.0)",
        "Own()(knee.position)",
        "TW011 wired outside a diagram: knee.position: the signal is used in arithmetic, and no diagram is open",
        "a step takes a signal as an input, and gets its value",
        before=OWN + "    def step(self, u):\n        return 2.0 * knee.position  # !\n",
        cure_before=OWN + "    def step(self, u):\n        return 2.0 * u\n",
    ),
)

PARAMETERS = (
    in_drive(
        "misspelt parameter",
        "Impedance(stifness=30.0)(0.0, 0.0)  # !",
        "Impedance(stiffness=30.0)(0.0, 0.0)",
        "has no parameter 'stifness'",
        "did you mean 'stiffness'?",
    ),
    in_drive(
        "parameter below its bound",
        "Impedance(stiffness=-3.0)(0.0, 0.0)  # !",
        "Impedance(stiffness=3.0)(0.0, 0.0)",
        "stiffness: must be at least 0.0 N·m/rad, got -3.0",
    ),
    in_drive(
        "text for a number",
        "Impedance(stiffness='30')(0.0, 0.0)  # !",
        "Impedance(stiffness=30)(0.0, 0.0)",
        "stiffness: expected a number, got '30'",
    ),
    in_drive(
        "text for a bool",
        "CubeMars('AK80-9', bus='legs', can_id=2, invert='yes')(torque_command=0.0)  # !",
        "CubeMars('AK80-9', bus='legs', can_id=2, invert=True)(torque_command=0.0)",
        "invert: expected True or False, got 'yes'",
    ),
    in_drive(
        "cutoff above half the rate",
        "Butterworth(2, 200.0)(knee.velocity)  # !",
        "Butterworth(2, 50.0)(knee.velocity)",
        "a cutoff of 200 Hz requires a rate above 400 Hz, got 200 Hz",
    ),
    in_drive(
        "parameter assigned above its bound",
        "law = Impedance()  # !\nlaw(0.0, 0.0)\nlaw.stiffness = 1e9",
        "law = Impedance()\nlaw(0.0, 0.0)\nlaw.stiffness = 40.0",
        "impedance: stiffness: must be at most 150.0 N·m/rad, got 1000000000.0",
    ),
    in_drive(
        "misspelt parameter assigned",
        "law = Impedance()  # !\nlaw(0.0, 0.0)\nlaw.stifness = 40.0",
        "law = Impedance()\nlaw(0.0, 0.0)\nlaw.stiffness = 40.0",
        "impedance: has no parameter 'stifness'",
        "did you mean 'stiffness'?",
    ),
    in_drive(
        "model without its board",
        "CubeMars('AK10-9', can_id=2)(torque_command=0.0)  # !",
        "CubeMars('AK10-9-V2.0', can_id=2)(torque_command=0.0)",
        "Use CubeMarsV3('AK10-9-V3.0')",
    ),
    in_drive(
        "id of another drive",
        "CubeMars('AK80-9', bus='legs', can_id=1, name='hip')(torque_command=0.0)  # !",
        "CubeMars('AK80-9', bus='legs', can_id=2, name='hip')(torque_command=0.0)",
        "shares CAN id 1 on bus 'legs'",
        "give each device on a bus its own `can_id`",
    ),
    in_drive(
        "fractional rate divisor",
        "Sine(every=0.5)()  # !",
        "Sine(every=2)()",
        "every must be a whole number of ticks, 1 or more, got 0.5",
    ),
)

FILES = (
    in_file(
        "build without return",
        BUILD,
        BUILD + "    return diagram\n",
        "build() returned None, and must return a Diagram: end it with `return diagram`",
    ),
    in_file(
        "build that returns two",
        BUILD + "    return diagram, 1\n",
        BUILD + "    return diagram\n",
        "build() returned (<Diagram knee",
        "end it with `return diagram`",
    ),
    in_file(
        "build with a required parameter",
        BUILD.replace("build()", "build(gain)") + "    return diagram\n",
        BUILD.replace("build()", "build(gain=1.0)") + "    return diagram\n",
        "build() cannot be called: missing a required argument: 'gain'",
        "give the parameter a default",
    ),
    in_file(
        "diagram with another name",
        DIAGRAM.replace("as diagram", "as robot"),
        DIAGRAM,
        "has no diagram: its Diagram is called 'robot': rename it to `diagram`",
    ),
    in_file(
        "two diagrams with other names",
        DIAGRAM.replace("as diagram", "as left") + DIAGRAM.replace("as diagram", "as right"),
        DIAGRAM + DIAGRAM.replace("as diagram", "as right"),
        "its Diagrams are called 'left', 'right': rename the one to run to `diagram`",
    ),
    in_file(
        "diagram without a name",
        DIAGRAM.replace(" as diagram", ""),
        DIAGRAM,
        "has no diagram: write `with Diagram(...) as diagram:`",
    ),
    in_file(
        "no with",
        'diagram = Diagram("knee", rate=200)\nSine()()  # !\n',
        DIAGRAM,
        "was created outside a diagram and cannot be connected",
        "create and connect it inside `with Diagram(...)`",
    ),
    in_file(
        "no rate",
        DIAGRAM.replace(", rate=200", "").replace("diagram:", "diagram:  # !"),
        DIAGRAM,
        "missing 1 required positional argument: 'rate'; pass the name and the rate in Hz",
    ),
    in_file(
        "period for rate",
        DIAGRAM.replace("rate=200", "dt=0.005").replace("diagram:", "diagram:  # !"),
        DIAGRAM,
        'as in Diagram("knee", rate=200)',
    ),
    in_file(
        "subsystem not entered",
        DIAGRAM + "    subsystem('left')  # !\n    Sine()()\n",
        DIAGRAM + "    with subsystem('left'):\n        Sine()()\n",
        "subsystem('left') contains no blocks",
        "write `with subsystem('left'):`",
    ),
    in_file(
        "run of a diagram",
        DIAGRAM + "diagram.run(10)  # !\n",
        DIAGRAM,
        "run it with `python -m runtime FILE`, or with runtime.run(diagram, duration=10)",
    ),
    in_file(
        "misspelt block of a diagram",
        DIAGRAM + "diagram['sne']  # !\n",
        DIAGRAM + "diagram['sine']\n",
        "knee has no block 'sne': did you mean 'sine'?",
    ),
    in_file(
        "plant that is no function",
        DIAGRAM + "plant = diagram\n",
        DIAGRAM,
        "plant is a Diagram: write a function plant(robot) that returns it",
    ),
    in_file(
        "file that runs itself",
        DIAGRAM + "import runtime\nruntime.run(__file__, 0.01)  # !\n",
        DIAGRAM + "import runtime\nif __name__ == '__main__':\n    runtime.run(__file__, 0.01)\n",
        "the file runs itself: run it from another file, or in `if __name__ == '__main__':`",
    ),
    in_file(
        "plant without robot",
        DIAGRAM + "def plant():  # !\n    return diagram\n",
        DIAGRAM,
        "declare it as plant(robot)",
    ),
    in_file("missing colon", DIAGRAM.replace("diagram:", "diagram  # !"), DIAGRAM, "expected ':'"),
)

BLOCKS = (
    in_block(
        "__init__ without super",
        f"def __init__(self):\n    self.sum = 0.0\n{STEP}",
        f"def reset(self):\n    self.sum = 0.0\n{STEP}",
        "Own.__init__ does not call super().__init__(), which makes the block",
        "declare parameters with Param, and set state in reset(self)",
    ),
    in_block(
        "__init__ without parameters",
        f"def __init__(self):\n    super().__init__()\n{STEP}",
        STEP,
        "got an unexpected keyword argument 'name'; remove Own.__init__",
        use="Own(name='own')(Sine()())  # !",
    ),
    in_block(
        "step without self", "def step(u):\n    return u", STEP, "Own.step takes no `self`: define step(self, u, ...)"
    ),
    in_block(
        "reset without self", f"def reset():\n    pass\n{STEP}", STEP, "Own.reset takes no `self`: define reset(self)"
    ),
    in_block(
        "step that yields", "def step(self, u):\n    yield u", STEP, "Own.step is a generator: end it with `return`"
    ),
    in_block("asynchronous step", f"async {STEP}", STEP, "Own.step is a coroutine: define it without `async`"),
    Mistake(
        "block in reset",
        diagram(
            "Own()(Sine()())", f"{OWN}    def reset(self):\n        self.slew = SlewRate(5.0)  # !\n    {STEP_INDENTED}"
        ),
        diagram("Own()(SlewRate(5.0)(Sine()()))", f"{OWN}    {STEP_INDENTED}"),
        (
            "unconnected input",
            "slew_rate is the attribute 'slew' of own, which connects nothing: create it in the diagram, not in a "
            "method of Own, and connect it there, as in own(SlewRate(...)(signal))",
        ),
    ),
    in_block(
        "state in the class",
        "past = []\ndef step(self, u):\n    self.past.append(u)\n    return sum(self.past)",
        "def reset(self):\n    self.past = []\ndef step(self, u):\n    self.past.append(u)\n    return sum(self.past)",
        "Own.past is one list for all blocks of the class: if it is state, set it in reset(self), as in self.past = []",
    ),
    in_block(
        "constant list",
        "weights = [0.5, 0.5]\ndef step(self, u):\n    return self.weights[0] * u",
        "WEIGHTS = [0.5, 0.5]\ndef step(self, u):\n    return self.WEIGHTS[0] * u",
        "if it is constant, write its name in upper case",
    ),
    in_block(
        "list as a default",
        f"k = Param([1.0, 2.0])  # !\n{STEP}",
        f"k = Param((1.0, 2.0))\n{STEP}",
        "all blocks would share the list [1.0, 2.0]: write the default as a tuple",
    ),
    in_block(
        "parameter without a default",
        "k = Param()\ndef step(self, u):\n    return self.k * u  # !",
        "k = Param(1.0)\ndef step(self, u):\n    return self.k * u",
        "the parameter k is None: pass a value, or declare a default, as in k = Param(1.0)",
    ),
    in_block(
        "bounds by position",
        f'k = Param(2.0, "1", 0.0, 10.0)  # !\n{STEP}',
        f'k = Param(2.0, "1", min=0.0, max=10.0)\n{STEP}',
        'as in Param(1.0, "N·m", "description", min=0.0, max=5.0)',
    ),
    in_block(
        "port without a unit",
        f"w = Input()  # !\n{STEP}",
        f'w = Input("1", default=0.0)\n{STEP}',
        'give its unit, as in Input("rad"); "1" is a number without a unit',
    ),
    in_block(
        "time as an attribute",
        "def step(self, u):\n    return self.time  # !",
        "def step(self, u, t):\n    return t",
        "take it as an argument, as in def step(self, u, t)",
    ),
    in_block(
        "unknown argument of step",
        "def step(self, v):\n    return v",
        STEP,
        "Own.step takes 'v', which is neither an input (u)",
    ),
    in_block(
        "parameter as argument",
        "k = Param(2.0)\ndef step(self, u, k):\n    return k * u",
        "k = Param(2.0)\ndef step(self, u):\n    return self.k * u",
        "it is a parameter: read self.k",
    ),
    in_block(
        "parameter without self",
        "k = Param(2.0)\ndef step(self, u):\n    return k * u  # !",
        "k = Param(2.0)\ndef step(self, u):\n    return self.k * u",
        "name 'k' is not defined",
        "read self.k",
    ),
    in_block(
        "step without return",
        "def step(self, u):\n    2.0 * u",
        "def step(self, u):\n    return 2.0 * u",
        "own.step returned None for y",
        "end the step with `return`",
    ),
    in_block(
        "step that returns two", "def step(self, u):\n    return u, u", STEP, "own.step returned (0.0, 0.0) for y"
    ),
    in_block(
        "array for a scalar",
        "def step(self, u):\n    return [u, u]",
        STEP,
        "own.step returned [0.0, 0.0] for y",
        'return one number for a scalar output, or declare its shape, as in Output("1", shape=(3,))',
    ),
    Mistake(
        "wrong number of outputs",
        diagram("Own()(Sine()())", TWO_OUTPUTS.replace("return u, u", "return u")),
        diagram("Own()(Sine()())", TWO_OUTPUTS),
        (
            "own.step must return 2 values (a, b), but returned 0.0",
            "return the outputs in their order, as in `return a, b`",
        ),
    ),
    Mistake(
        "dict of outputs",
        diagram("Own()(Sine()())", TWO_OUTPUTS.replace("return u, u", "return {'a': u, 'b': u}")),
        diagram("Own()(Sine()())", TWO_OUTPUTS),
        ("but returned {'a': 0.0, 'b': 0.0}", "return the outputs in their order, as in `return a, b`"),
    ),
    Mistake(
        "array of another shape",
        diagram("Own()(1.0)", VECTOR.format("[u, u]")),
        diagram("Own()(1.0)", VECTOR.format("[u, u, u]")),
        (
            "own.step returned [1.0, 1.0] for y: expected shape (3,), got (2,)",
            "return an array of shape (3,), or declare y with shape=(2,)",
        ),
    ),
    Mistake(
        "complex array",
        diagram("Own()(1.0)", VECTOR.format("numpy.exp(1j * numpy.array([u, u, u]))")),
        diagram("Own()(1.0)", VECTOR.format("numpy.exp(1j * numpy.array([u, u, u])).real")),
        ("own.step returned array(", "for y: must be real numbers, not complex"),
    ),
    in_block(
        "endless recursion",
        "def step(self, u):\n    return self.step(u)  # !",
        STEP,
        " further calls",
        "RecursionError",
    ),
    in_block(
        "last output as state",
        "def step(self, u):\n    return 0.9 * self.y + u  # !",
        "def reset(self):\n    self.last = 0.0\ndef step(self, u):\n    self.last = 0.9 * self.last + u\n"
        "    return self.last",
        "own.y: the signal is used in arithmetic, and no diagram is open",
        "it stores its last output in an attribute of another name",
    ),
    in_block(
        "state without reset",
        "def step(self, u):\n    self.sum += u  # !\n    return self.sum",
        "def reset(self):\n    self.sum = 0.0\ndef step(self, u):\n    self.sum += u\n    return self.sum",
        "'Own' object has no attribute 'sum'",
        "set it in reset(self), as in self.sum = 0.0",
    ),
    in_block(
        "input as an attribute",
        "def step(self):\n    return 2.0 * self.u  # !",
        "def step(self, u):\n    return 2.0 * u",
        "unsupported operand type(s) for *: 'float' and 'Input'",
        "take an input as an argument of the step, as in def step(self, angle)",
    ),
    in_block(
        "returned input",
        "def step(self):\n    return self.u",
        STEP,
        "own.step returned Input('u', 'any') for y",
        "take an input as an argument of the step",
    ),
    in_block(
        "misspelt step",
        "def Step(self, u):\n    return u",
        STEP,
        "Own has neither a step nor a kernel",
        "define step(self, u)",
    ),
    in_block(
        "division by zero",
        "def step(self, u):\n    return 1.0 / u  # !",
        "def step(self, u):\n    return 1.0 / (1.0 + u * u)",
        "its inputs: u = 0",
        "ZeroDivisionError",
    ),
    in_block(
        "declaration without parentheses",
        "w = Input\ndef step(self, u, w):\n    return u + w",
        'w = Input("any")\ndef step(self, u, w):\n    return u + w',
        'write `w = Input("1")`, with the unit in parentheses',
        use="Own()(1.0, 1.0)",
    ),
    in_block(
        "annotation for a declaration",
        'w: Input("any")\ndef step(self, u, w):\n    return u + w',
        'w = Input("any")\ndef step(self, u, w):\n    return u + w',
        'write `w = Input("1")`, with `=` instead of `:`',
        use="Own()(1.0, 1.0)",
    ),
    in_block(
        "reserved name", f"every = Param(2.0)\n{STEP}", STEP, "'every' is reserved and cannot name a port or parameter"
    ),
    in_block(
        "unknown unit",
        f'w = Input("furlong", default=0.0)  # !\n{STEP}',
        f'w = Input("m", default=0.0)\n{STEP}',
        "'furlong' is not a unit",
    ),
    in_block(
        "plain class attribute",
        f"gain = 2.0\n{STEP}",
        f"gain = Param(2.0)\n{STEP}",
        "has no parameter 'gain'",
        "declare it in the class, as in gain = Param(1.0, unit)",
        use="Own(gain=3.0)(Sine()())  # !",
    ),
    Mistake(
        "class without Block",
        diagram("Own()(Sine()())  # !", OWN.replace("(Block)", "") + "    def step(self, u):\n        return u\n"),
        diagram("Own()(Sine()())", OWN + "    def step(self, u):\n        return u\n"),
        ("'Own' object is not callable; derive the class from Block: class Own(Block)",),
    ),
    in_drive(
        "unit for a declaration",
        "double()(knee.position)",
        "double()(knee.position)",
        "double: 'rad' in its annotations is not defined: annotate an argument with Input(unit)",
        before="@block\ndef double(u: 'rad') -> 'rad':\n    return 2.0 * u\n",
        cure_before='@block\ndef double(u: Input("rad")) -> Output("rad"):\n    return 2.0 * u\n',
    ),
    in_drive(
        "parentheses of the decorator",
        "double()(knee.position)",
        "double()(knee.position)",
        "omit the parentheses of the decorator: @block",
        before='@block()\ndef double(u: Input("rad")) -> Output("rad"):\n    return 2.0 * u\n',
        cure_before='@block\ndef double(u: Input("rad")) -> Output("rad"):\n    return 2.0 * u\n',
    ),
    in_drive(
        "function without annotations",
        "double()(knee.position)",
        "double()(knee.position)",
        "double has no return annotation: add -> Output(unit)",
        before="@block\ndef double(u):\n    return 2.0 * u\n",
        cure_before='@block\ndef double(u: Input("any")) -> Output("any"):\n    return 2.0 * u\n',
    ),
)

MISTAKES = (*OPERATIONS, *IMPORTS_AND_NAMES, *WIRES, *PARAMETERS, *FILES, *BLOCKS)
