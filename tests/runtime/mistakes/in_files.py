"""Mistakes in a diagram file: imports, names, syntax, and the functions `build` and `plant`."""

from tests.runtime.mistakes.sources import BUILD, COMMAND, DIAGRAM, LAW, Mistake, diagram, in_drive, in_file

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
        "block in lower case",
        f"from blocks.filters import notch  # !\n{DIAGRAM}",
        f"from blocks.filters import Notch\n{DIAGRAM}",
        "did you mean 'Notch'?",
    ),
    in_file(
        "block by the name that another program gives it",
        f"from blocks.filters import LowPass  # !\n{DIAGRAM}",
        f"from blocks.filters import Butterworth\n{DIAGRAM}",
        "its blocks are Butterworth, Complementary, Exponential, Median, Notch",
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
