"""Mistakes in what is read from a diagram, a block or a signal, and in the values that are passed to them."""

from tests.runtime.mistakes.sources import DRIVE, REST, Mistake, diagram, in_drive

READ = "x = knee.position"


def after(name, wrong, right, *message):
    """Mistake below the `with` statement of a diagram with an actuator at rest."""
    text = diagram(f"{DRIVE}\n{REST}")
    return Mistake(name, f"{text}{wrong}  # !\n", f"{text}{right}\n", message)


ATTRIBUTES = (
    in_drive(
        "value of a signal",
        "x = knee.position.value  # !",
        READ,
        "knee.position is a signal, which has no attribute 'value'; it has no value until the diagram runs",
        "read the recording after the run, as in trial['left/knee.position']",
    ),
    in_drive(
        "unit of a signal",
        "x = knee.position.unit  # !",
        "x = knee.position.declaration.unit",
        "has no attribute 'unit'; read its declaration, as in signal.declaration.unit",
    ),
    in_drive(
        "method of an array", "x = knee.position.mean()  # !", READ, "has no attribute 'mean'; use a block such as Sin"
    ),
    in_drive(
        "signal assigned to",
        "knee.position.value = 1.0  # !",
        READ,
        "a signal cannot be assigned to: connect it, as in block(signal)",
    ),
    in_drive(
        "index of a signal that is text",
        "from graph import stack; x = stack(knee.position, 0.0)['a']  # !",
        "from graph import stack; x = stack(knee.position, 0.0)[0]",
        "a signal is indexed with whole numbers, as in gyro[1], got 'a'",
    ),
    in_drive(
        "index of a block",
        "x = knee['position']  # !",
        READ,
        "'CubeMars' object is not subscriptable; choose one of its outputs: position, velocity, torque",
    ),
    in_drive(
        "block with several outputs in an operation",
        "x = knee * 2.0  # !",
        "x = knee.position * 2.0",
        "choose one of its outputs: position, velocity, torque",
    ),
    in_drive(
        "input assigned among the declarations",
        "knee.inputs['torque_command'] = 1.0  # !",
        "",
        "'torque_command' cannot be assigned: all blocks of a class share its declarations",
        "connect an input by calling its block, as in block(torque_command=...)",
    ),
    after(
        "rate that is text",
        "diagram.rate = '100'",
        "diagram.rate = 100",
        "the rate must be a number above 0 Hz and at most 1e+09 Hz, got '100'",
    ),
    after(
        "name with a slash", "diagram.name = 'left/knee'", "diagram.name = 'left knee'", "'left/knee' cannot be a name"
    ),
    Mistake(
        "parameter that is text",
        diagram(f"{DRIVE}\n{REST}") + "knee.timeout = 'long'\n",
        diagram(f"{DRIVE}\n{REST}") + "knee.timeout = 0.5\n",
        ("knee.py:11", "timeout: expected a number, got 'long'"),
    ),
    in_drive(
        "output assigned",
        "knee.torque = 2.0",
        "",
        "2.0 was assigned to its output 'torque'",
        "omit the assignment, or connect an input, as in knee(torque_command=...)",
    ),
    after(
        "block of a diagram as an attribute",
        "diagram.knee",
        "diagram['knee']",
        "'Diagram' object has no attribute 'knee'; its blocks are diagram[\"left/knee\"], by their paths",
    ),
    after(
        "signal of a diagram",
        "diagram['knee.position']",
        "diagram['knee'].position",
        "knee has no block 'knee.position': an output is diagram['knee'].position",
    ),
    in_drive(
        "block of a subsystem as an attribute",
        "leg = subsystem('left')\nwith leg:\n    Sine()()\nx = leg.sine  # !",
        "leg = subsystem('left')\nwith leg:\n    Sine()()",
        'its blocks are diagram["left/knee"], by their paths',
    ),
    after("drawing by a method", "diagram.draw()", "", "draw it with `python -m runtime draw FILE`"),
    after(
        "compile of a path",
        "from graph import compile; compile('knee.py')",
        "from graph import compile; compile(diagram)",
        "compile() takes a Diagram, got 'knee.py'; runtime.check takes a file",
    ),
)

VALUES = (
    in_drive(
        "number as text",
        'Butterworth(2, "20")(knee.velocity)  # !',
        "Butterworth(2, 20)(knee.velocity)",
        "cutoff: expected a number, got '20': omit the quotes",
    ),
    in_drive(
        "file name for a table",
        "from blocks.tables import LookupTable1D; LookupTable1D('a.csv')(0.5)  # !",
        "from blocks.tables import LookupTable1D; LookupTable1D([0, 1], [0, 1])(0.5)",
        "breakpoints must contain at least one number, all finite, got 'a.csv'",
    ),
    in_drive(
        "several angles in degrees",
        "from graph import deg; x = deg([-10, 90])  # !",
        "from graph import deg; x = (deg(-10), deg(90))",
        "deg() converts one number, got [-10, 90]: convert each, as in (deg(-10), deg(90))",
    ),
    in_drive(
        "option of all blocks as a parameter",
        "Butterworth(2, 20.0, live=True)(knee.velocity)  # !",
        "Butterworth(2, 20.0)(knee.velocity)",
        "has no parameter 'live'",
        "it has order, cutoff, btype",
    ),
    in_drive(
        "too many signals",
        "Butterworth(2, 20.0)(knee.velocity, knee.position)  # !",
        "Butterworth(2, 20.0)(knee.velocity)",
        "has 1 input (u), got 2 signals",
        "pass one signal for each input",
    ),
    in_drive(
        "signal for a source",
        "Sine()(knee.position)  # !",
        "Sine()()",
        "has 0 inputs (none), got 1 signal",
        "call it without arguments",
    ),
    in_drive(
        "missing file",
        'from blocks.sources import Playback; Playback("no.csv", "a")()  # !',
        "",
        "file: there is no no.csv in /",
        "or in the working folder: copy it there, or write its absolute path",
    ),
    in_drive(
        "folder instead of a file",
        'from blocks.sources import Playback; Playback(".", "a")()  # !',
        "",
        "file: . is a folder: name a file in it",
    ),
    in_drive(
        "missing model",
        'from blocks.networks import OnnxModel; OnnxModel("no.onnx")()  # !',
        "",
        "there is no no.onnx in /",
        "copy it there, or write its absolute path",
    ),
    in_drive("unknown block", "LowPass(20.0)(knee.velocity)  # !", "", "`python -m runtime blocks` lists all blocks"),
)
