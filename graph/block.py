"""Blocks: a class with declared ports and parameters, and a step in Python or a native kernel.

A declaration carries its documentation: the reference page, the drawing, the CSV header and the error messages are made
from it. Within a block each name is used once.
"""

import inspect
import math
import re

import numpy as np

from graph import units
from graph.diagnostics import Diagnostic, DiagramError, caller
from graph.diagram import Outputs, Signal, current_scope, is_count
from graph.interval import EVERYTHING, Interval

DTYPES = {float: "float", int: "int", bool: "bool", "float": "float", "int": "int", "bool": "bool"}
CLOCK = {"t": 0, "tick": 1, "dt": 2}          # arguments that every step may ask for, and their slots in the arena


class _Declaration:
    name = ""

    def __set_name__(self, owner, name):
        self.name = name

    def named(self, name):
        """The declaration itself, for ports that a block makes while it is configured."""
        self.name = name
        return self


class _Port(_Declaration):
    def __init__(self, unit, description="", *, shape=(), dtype=float):
        if shape is not ... and not (isinstance(shape, tuple) and all(isinstance(length, int) and length > 0 for length in shape)):
            raise TypeError(f"a shape is a tuple of lengths, as in (3,), or ..., not {shape!r}")
        if dtype not in DTYPES:
            raise TypeError(f"a dtype is float, int or bool, not {dtype!r}")
        self.unit = units.canonical(unit)
        self.description = description
        self.shape = shape
        self.dtype = DTYPES[dtype]

    def __repr__(self):
        return f"{type(self).__name__}({self.name!r}, {self.unit!r})"


class Input(_Port):
    """An input port.

    unit : canonical SI string, or "any": all "any" ports of a block share one unit
    shape : (), (3,), ...; `...` for any shape, the same for all such ports of a block
    dtype : float, int or bool
    default : value of an unwired input; without one, leaving it unwired is an error
    """

    def __init__(self, unit, description="", *, shape=(), dtype=float, default=None):
        super().__init__(unit, description, shape=shape, dtype=dtype)
        self.default = default


class Output(_Port):
    """An output port. range : (low, high) that the output never leaves, if the block can promise one."""

    def __init__(self, unit, description="", *, shape=(), dtype=float, range=None):
        super().__init__(unit, description, shape=shape, dtype=dtype)
        self.range = Interval(*range) if range is not None else None

    def __get__(self, block, owner=None):
        return self if block is None else Signal(block, self.name)


class Param(_Declaration):
    """A parameter, a plain attribute of the block once it is built.

    default : its value when none is given; its type is the parameter's
    unit : of the value
    min, max : inclusive bounds; above, below : exclusive ones
    choices : the values allowed
    live : may change while running; needs min and max
    required : there is no default
    """

    def __init__(self, default=None, unit="1", description="", *, min=None, max=None, above=None, below=None, choices=None,
                 live=False, required=False, dtype=None):
        self.default, self.unit, self.description = default, units.canonical(unit), description
        self.min, self.max, self.above, self.below, self.choices = min, max, above, below, choices
        self.live, self.required = live, required
        self.dtype = dtype or (float if default is None else type(default))
        if live and (min is None or max is None):
            raise TypeError("a live parameter needs both bounds, min and max")

    @property
    def numeric(self):
        return self.dtype in (float, int, bool)

    def check(self, value):
        """The value in the parameter's type; None where that is the default. ValueError saying which bound it breaks."""
        if value is None and (self.default is None and not self.required or self.dtype is object):
            return None
        if value is None:
            raise ValueError("a value is wanted, got None")
        if isinstance(value, str) and self.numeric:
            raise ValueError(f"expected a number, got {value!r}")
        if self.dtype is bool and not isinstance(value, (bool, np.bool_)):
            raise ValueError(f"expected True or False, got {value!r}")
        if self.numeric and np.ndim(value):
            raise ValueError(f"expected one number, got {value!r}")
        if self.dtype is int and (isinstance(value, bool) or not math.isfinite(value) or value != int(value)):
            raise ValueError(f"expected a whole number, got {value!r}")
        if self.dtype is str and not isinstance(value, str):
            raise ValueError(f"expected text, got {value!r}")
        if self.numeric:
            value = self.dtype(value)
            if value != value:
                raise ValueError("NaN is not allowed")
            unit = "" if self.unit in (units.ONE, units.ANY) else f" {self.unit}"
            for broken, words in (
                (self.min is not None and value < self.min, f"at least {self.min}"),
                (self.max is not None and value > self.max, f"at most {self.max}"),
                (self.above is not None and value <= self.above, f"above {self.above}"),
                (self.below is not None and value >= self.below, f"below {self.below}"),
            ):
                if broken:
                    raise ValueError(f"must be {words}{unit}, got {value}")
        if self.choices is not None and value not in self.choices:
            raise ValueError(f"must be one of {', '.join(map(str, self.choices))}, got {value!r}")
        return value

    def parse(self, text):
        """The value of a command-line text, '40', '60 deg', 'true'. ValueError if it is none."""
        if self.dtype is bool:
            truths = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}
            if text.lower() not in truths:
                raise ValueError(f"expected true or false, got {text!r}")
            return truths[text.lower()]
        if self.dtype is object:
            try:
                return self.check(float(text))
            except ValueError:
                return self.check(text)
        if self.dtype is tuple:
            raise ValueError("cannot be set from the command line")
        if not self.numeric:
            return self.check(text)
        value = units.parse_quantity(text, self.unit)
        return self.check(value)


class Live:
    """A parameter's value that may change while running, within bounds: `limit=Live(12.0, max=15.0)`.

    Bounds left out are the parameter's own; a live parameter needs both, and the proof takes it over all of them.
    """

    def __init__(self, value, *, min=None, max=None):
        self.value, self.min, self.max = value, min, max

    def bounds(self, param):
        low = param.min if self.min is None else param.check(self.min)
        high = param.max if self.max is None else param.check(self.max)
        if low is None or high is None or not param.numeric:
            raise ValueError("a live parameter needs both bounds: write Live(value, min=..., max=...)")
        if not (math.isfinite(low) and math.isfinite(high) and low <= high):
            raise ValueError(f"live bounds must be finite and in order, got {low:g} to {high:g}")
        return low, high


class Memory(_Declaration):
    """State or coefficients of a native block, in the arena. `initial` is its value at reset; `prepare` may set another of any length."""

    def __init__(self, initial=0.0, description=""):
        self.initial, self.description = initial, description


class Block:
    """Base of all blocks.

    A Python block defines `step(self, *inputs)`, called with floats (vectors: read-only views, valid during the call) and
    returning its outputs. Inputs that `step` does not take have no direct feedthrough. With state it may have
    `update(self, *inputs)`, run at the end of the tick, `reset()`, and `settle(self, *inputs)`, which takes the present inputs
    as the steady state when a robot has been armed. A step may also take `t`, `tick` and `dt`.

    A native block names a `kernel`, and `update_kernel` and `settle_kernel` where it needs them; `feedthrough` names the
    inputs its kernel reads, all by default.

    Hooks: `configure()` after the parameters are set; `prepare(dt)` when the sampling period is known; `output_range`
    for the proof; `output_units` where outputs have units of their own.
    """

    kernel = update_kernel = settle_kernel = None
    feedthrough = None
    inputs = outputs = parameters = memory = {}
    variadic = False            # takes any number of signals
    width = 1                   # how many elements its `...` ports have, once it is known
    every = 1                   # runs at every n-th tick
    conditions = ()             # signals that must all be true for it to run
    resamples = False           # may stand between rates that do not divide
    jit = False                 # a Python block that shall be compiled to a kernel, where Numba is installed
    compiled = False            # it has been
    diagram = None
    path = ""
    _scratch = None

    def __init_subclass__(cls, **options):
        super().__init_subclass__(**options)
        cls._own = {n: d for n, d in vars(cls).items() if isinstance(d, Param)}
        for name in cls._own:
            delattr(cls, name)      # an attribute that the class has too is found slowly by CPython 3.11: a step would take a quarter longer
        declared = {}
        for base in reversed(cls.__mro__):
            names = vars(base) | vars(base).get("_own", {})
            declared.update({n: d for n, d in names.items() if isinstance(d, _Declaration) or n in declared})
        for kind, field in ((Input, "inputs"), (Output, "outputs"), (Param, "parameters"), (Memory, "memory")):
            setattr(cls, field, {n: d for n, d in declared.items() if isinstance(d, kind)})
        taken = next((name for name in declared if name in _WORDS), None)
        if taken is not None:
            raise TypeError(f"{cls.__name__}: {taken!r} is a word of the language and cannot name a port or parameter")
        for method in ("step", "update", "settle"):
            function = vars(cls).get(method)
            if function is None or cls.variadic:
                continue
            names, takes_all = _arguments(function)
            strangers = [] if takes_all else [n for n in names if n not in cls.inputs and n not in CLOCK]
            if strangers:
                raise TypeError(
                    f"{cls.__name__}.{method} takes {strangers[0]!r}, which is neither an input ({', '.join(cls.inputs) or 'none'}) "
                    f"nor one of {', '.join(CLOCK)}"
                )

    def __init__(self, *values, name=None, every=1, **named):
        self.dt = None              # s, the block's own sampling period, once it is known
        self.location = caller()
        self.live_bounds = {}
        self.every = every
        self._set_parameters(values, named)
        scope = current_scope()
        if scope is not None:
            scope.adopt(self, name)
        else:
            self.path = name or snake_case(type(self).__name__)
        self._attempt(self.configure)
        if self.is_python and (self.dt is not None or type(self).prepare is Block.prepare):
            self._attempt(self.prepare, self.dt)
            self.reset()

    def _set_parameters(self, values, named):
        who = type(self).__name__
        problems = []

        def wrong(message, hint=""):
            problems.append(Diagnostic("TW010", message, path=who, where=self.location, hint=hint))

        names = list(self.parameters)
        if len(values) > len(names):
            wrong(f"takes {len(names)} parameters ({', '.join(names) or 'none'}), and {len(values)} were given")
        given = dict(zip(names, values))
        for key, value in named.items():
            if key not in self.parameters:
                wrong(f"has no parameter {key!r}", suggestion(key, names) or f"it has {', '.join(names) or 'none'}")
            elif key in given:
                wrong(f"{key} was given twice")
            else:
                given[key] = value
        for key, param in self.parameters.items():
            if key not in given and param.required:
                wrong(f"{key} is missing", param.description)
                continue
            value = given.get(key, param.default)
            try:
                if isinstance(value, Live):
                    self.live_bounds[key] = value.bounds(param)
                    value = value.value
                setattr(self, key, self.check_live(key, param.check(value)))
            except (ValueError, TypeError, OverflowError) as error:
                wrong(f"{key}: {error}", param.description)
        if not is_count(self.every):
            problems.append(Diagnostic(
                "TW014", f"every must be a whole number of ticks, 1 or more, got {self.every!r}", path=who, where=self.location,
                hint="every=2 runs the block in every second tick"))
        if problems:
            raise DiagramError(problems)

    # What a block's author may define

    def configure(self):
        """Called once, when the parameters are set: derive what does not depend on the sampling period."""

    def prepare(self, dt):
        """Called when the sampling period dt, in s, is known: set memory that depends on it."""

    def reset(self):
        """Back to the state before the first step."""
        self._scratch = None

    def output_range(self, **inputs):
        """Interval of each output from those of the inputs: an Interval, or a dict by name. Default: what the outputs declare."""
        return {}

    def output_units(self, **inputs):
        """Units of outputs that differ from the rule that all "any" ports share one: a dict by name."""
        return {}

    # Using a block

    def __call__(self, *signals, **named):
        """Wire the inputs, by position or by name; numbers become constants. Returns the output, or all of them."""
        where = caller()
        if self.diagram is None:
            raise DiagramError(Diagnostic(
                "TW011", "is wired, but was made outside a diagram", path=self.path, where=where,
                hint="make and wire it inside `with Diagram(...)`; to compute one step by hand, call .step(...)"))
        names = list(self.inputs)
        if not self.variadic and len(signals) > len(names):
            raise DiagramError(Diagnostic(
                "TW012", f"has {len(names)} inputs ({', '.join(names) or 'none'}), and {len(signals)} were wired", path=self.path,
                where=where))
        wires = [(None if self.variadic else name, signal) for name, signal in zip(names or [None] * len(signals), signals)]
        if self.variadic:
            wires = [(None, signal) for signal in signals]
        for name, signal in wires + list(named.items()):
            if not self.variadic and name not in self.inputs:
                raise DiagramError(Diagnostic(
                    "TW012", f"has no input {name!r}", path=self.path, where=where,
                    hint=suggestion(name, names) or f"its inputs are {', '.join(names) or 'none'}"))
            self.diagram.wire(signal, self, name, where)
        return self.result()

    def result(self):
        """What wiring gives back: the output, a named tuple of several, or the block itself if it has none."""
        if not self.outputs:
            return self
        signals = [Signal(self, name) for name in self.outputs]
        return signals[0] if len(signals) == 1 else Outputs(self.outputs, signals)

    def step(self, *values, **named):
        """Compute one step by hand: inputs as numbers, outputs back. A native block runs its kernel on an arena of its own."""
        return self.scratch.step(values, named)

    def update(self, *values, **named):
        """Compute one update by hand, where the block has one."""
        return self.scratch.update(values, named)

    @property
    def scratch(self):
        from graph.scratch import Scratch

        if self._scratch is None:
            self._scratch = Scratch(self)
        return self._scratch

    @property
    def is_python(self):
        return type(self).step is not Block.step and not self.compiled

    @property
    def has_python_update(self):
        return type(self).update is not Block.update and not self.compiled

    def step_inputs(self):
        """Names of the inputs with direct feedthrough, in the order the step takes them, and of the clock arguments among them."""
        if self.is_python:
            return self.arguments_of("step")
        return list(self.inputs if self.feedthrough is None else self.feedthrough)

    def update_inputs(self):
        return self.arguments_of("update") if self.has_python_update else []

    def arguments_of(self, method):
        """Names of the inputs and clock arguments that a method takes, in its order; `*inputs` takes all that it does not name."""
        names, takes_all = _arguments(getattr(type(self), method))
        return names + [name for name in self.inputs if name not in names] if takes_all else names

    def set(self, name, text):
        """Set a parameter from command-line text, before the compile. DiagramError if there is none of that name or the value is wrong."""
        if name not in self.parameters:
            raise DiagramError(Diagnostic(
                "TW010", f"has no parameter {name!r}", path=self.path,
                hint=suggestion(name, self.parameters) or f"it has {', '.join(self.parameters) or 'none'}"))
        try:
            setattr(self, name, self.check_live(name, self.parameters[name].parse(text)))
        except ValueError as error:
            raise DiagramError(Diagnostic("TW010", f"{name}: {error}", path=self.path, hint=self.parameters[name].description)) from None
        self._attempt(self.configure)

    def check_live(self, name, value):
        """The value, if the parameter may have it at the start of a run too: a proof rests on its live bounds."""
        low, high = self.live_bounds.get(name, (-math.inf, math.inf))
        if name in self.live_bounds and not low <= value <= high:
            raise ValueError(f"must be between its live bounds {low:g} and {high:g}, got {value}")
        return value

    def live(self, name):
        """(smallest, largest) value that a parameter may take while running, or None if it is not live."""
        param = self.parameters[name]
        return self.live_bounds.get(name) or ((param.min, param.max) if param.live else None)

    def span(self, name):
        """Interval of a parameter: its value, or all it may become if it is live."""
        bounds = self.live(name)
        return Interval(*map(float, bounds)) if bounds else Interval.point(getattr(self, name))

    def _attempt(self, method, *arguments):
        """Run one of the author's hooks; a ValueError becomes a diagnostic at the user's line."""
        try:
            return method(*arguments)
        except OSError as error:
            message = f"cannot read {error.filename}: {error.strerror}"
        except ValueError as error:
            message = str(error)
        raise DiagramError(Diagnostic("TW010", message, path=self.path, where=self.location))

    def __repr__(self):
        return f"<{type(self).__name__} {self.path}>"


# Names that a declaration would take from every block.
_WORDS = {word for word in vars(Block) if not word.startswith("_")} | {"name", "dt", "every", "location", "settle"}


class Sink(Block):
    """A block that only takes: a recorder or a viewer. It has no step; the recorder process serves it. Unwired, it takes every port."""

    variadic = True
    service = ""                # "module:class" of what serves it in the recorder process


def _arguments(function):
    """(names of the positional arguments after self, whether it takes any number of them). TypeError where one must be named."""
    kinds = inspect.Parameter
    parameters = list(inspect.signature(function).parameters.values())
    named = next((p.name for p in parameters if p.kind is kinds.KEYWORD_ONLY and p.default is kinds.empty), None)
    if named is not None:
        raise TypeError(f"{function.__qualname__} takes {named!r} by name only, and inputs are given by position")
    names = [p.name for p in parameters if p.kind in (kinds.POSITIONAL_ONLY, kinds.POSITIONAL_OR_KEYWORD)]
    return names[1:], any(p.kind is kinds.VAR_POSITIONAL for p in parameters)


def snake_case(name):
    """'TorqueLimiter' gives 'torque_limiter'; 'PID' gives 'pid'; 'CubeMars' gives 'cube_mars'; 'LookupTable1D' gives 'lookup_table_1d'."""
    return re.sub(r"(?<=[a-z])(?=[A-Z]|[0-9][A-Z](?![a-z]))|(?<=[A-Z0-9])(?=[A-Z][a-z])", "_", name).lower()


def suggestion(word, known):
    """'did you mean ...?' for a misspelt word, or ''."""
    import difflib

    close = difflib.get_close_matches(str(word), list(known), n=1)
    return f"did you mean {close[0]!r}?" if close else ""


def range_of(block, name, ranges):
    """Interval of one output, given what `output_range` returned: within what the port declares."""
    port = block.outputs[name]
    found = ranges.get(name) if isinstance(ranges, dict) else ranges
    if port.range is None:
        return EVERYTHING if found is None else found
    return port.range if found is None else found & port.range


def size_of(shape):
    return math.prod(shape)
