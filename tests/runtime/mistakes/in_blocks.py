"""Mistakes in the class of a block."""

from tests.runtime.mistakes.sources import (
    OWN,
    STEP,
    STEP_INDENTED,
    TWO_OUTPUTS,
    VECTOR,
    Mistake,
    diagram,
    in_block,
    in_drive,
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
        "description before the unit",
        f'a = Input("in", "rad", default=0.0)  # !\n{STEP}',
        f'a = Input("rad", "in", default=0.0)\n{STEP}',
        "the unit comes first, as in Input('rad', 'in')",
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
        "step that returns two",
        "def step(self, u):\n    return u, u",
        STEP,
        "own.step returned 2 values (0.0, 0.0), and the block has one output, y: return one value, or declare",
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
