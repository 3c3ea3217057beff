"""Blocks: a class with declared ports and parameters, and a step in Python or a native kernel."""

import inspect

from graph.declarations import Declaration, Input, Live, Memory, Output, Param
from graph.diagnostics import Diagnostic, DiagramError, caller
from graph.diagram import current_scope, is_count
from graph.interval import EVERYTHING, Interval
from graph.kernel_items import check_inherited_kernels, replace_kernels
from graph.names import snake_case, suggestion
from graph.scratch import Scratch
from graph.signal import Outputs, Signal

CLOCK = {"t": 0, "tick": 1, "dt": 2}  # arguments that every step may ask for, and their slots in the arena


class Block:
    """Base of all blocks.

    A Python block defines `step(self, *inputs)`, called with floats (vectors: read-only views, valid during the call)
    and returning its outputs. Inputs that `step` does not take have no direct feedthrough. With state it may have
    `update(self, *inputs)`, run at the end of the tick, `reset()`, and `settle(self, *inputs)`, which takes the present
    inputs as the steady state when a robot has been armed. A step may also take `t`, `tick` and `dt`.

    A native block names a `kernel`, and `update_kernel` and `settle_kernel` where it needs them; `feedthrough` names
    the inputs its kernel reads, all by default. A kernel finds its items by position, so a class that inherits one
    keeps its inputs, outputs, placed parameters and memory as they are; a `step` in Python replaces inherited kernels.

    Hooks: `configure()` after the parameters are set; `prepare(dt)` when the sampling period is known; `output_range`
    for the proof; `output_units` where outputs have units of their own.
    """

    kernel = update_kernel = settle_kernel = None
    feedthrough = None
    inputs = outputs = parameters = memory = {}
    free_units = ()  # "any" inputs that need not share the one unit of the others
    variadic = False  # takes any number of signals
    width = 1  # how many elements its `...` ports have, once it is known
    every = 1  # runs at every n-th tick
    # steps in a row that may raise while its outputs keep their last values; 0: the first is a fault
    hold_exceptions = 0
    conditions = ()  # signals that must all be true for it to run
    resamples = False  # may stand where rates meet that do not divide, as Hold may
    models_heat = False  # tells how hot an actuator is that does not tell by itself
    always = False  # must run in every tick: in no slower subsystem, and in none that may be disabled
    abstract = False  # what others are made of, and stands in no list: where a class itself says so
    output_slew = None  # fastest change of its output per second, where the block bounds it
    jit = False  # a Python block that shall be compiled to a kernel, where Numba is installed
    compiled = False  # it has been
    diagram = None
    path = ""
    _scratch = None

    def __init_subclass__(cls, **options):
        super().__init_subclass__(**options)
        cls._own = {n: d for n, d in vars(cls).items() if isinstance(d, Param)}
        for name in cls._own:
            # an attribute that the class has too is found slowly by CPython 3.11: a step would take a quarter longer
            delattr(cls, name)
        declared = {}
        for base in reversed(cls.__mro__):
            names = vars(base) | vars(base).get("_own", {})
            declared.update({n: d for n, d in names.items() if isinstance(d, Declaration) or n in declared})
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
                    f"{cls.__name__}.{method} takes {strangers[0]!r}, which is neither an input "
                    f"({', '.join(cls.inputs) or 'none'}) "
                    f"nor one of {', '.join(CLOCK)}"
                )
        if cls.step is not Block.step:
            replace_kernels(cls)
        check_inherited_kernels(cls)

    def __init__(self, *values, name=None, every=1, hold_exceptions=0, **named):
        self.dt = None  # s, the block's own sampling period, once it is known
        self.location = caller()
        self.live_bounds = {}
        self.every, self.hold_exceptions = every, hold_exceptions
        self._set_parameters(values, named)
        scope = current_scope()
        if scope is not None:
            scope.adopt(self, name)
        else:
            self.path = name or snake_case(type(self).__name__)
        self._configure()
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
            problems.append(
                Diagnostic(
                    "TW014",
                    f"every must be a whole number of ticks, 1 or more, got {self.every!r}",
                    path=who,
                    where=self.location,
                    hint="every=2 runs the block in every second tick",
                )
            )
        if not (is_count(self.hold_exceptions) or (type(self.hold_exceptions) is int and self.hold_exceptions == 0)):
            wrong(
                f"hold_exceptions must be a whole number of steps in a row, got {self.hold_exceptions!r}",
                "0: the first exception is a fault",
            )
        elif self.hold_exceptions and not (self.is_python or self.has_python_update):
            wrong("takes no hold_exceptions: it does not run in Python and raises none", "leave it out")
        if problems:
            raise DiagramError(problems)

    def _configure(self):
        self._attempt(self.configure)
        if self.kernel is not None and type(self).kernel is None and not self.compiled:
            raise TypeError(
                f"{type(self).__name__} chooses its kernel in configure: name one of them on the class "
                "too, so that its subclasses "
                "are checked against it"
            )
        for name in self.outputs:
            if not hasattr(type(self), name):
                setattr(self, name, Signal(self, name))  # of an output that the parameters have made

    # What a block's author may define

    def configure(self):
        """Called once, when the parameters are set: derive what does not depend on the sampling period."""

    def prepare(self, dt):
        """Called when the sampling period dt, in s, is known: set memory that depends on it."""

    def reset(self):
        """Back to the state before the first step."""
        self._scratch = None

    def output_range(self, **inputs):
        """Interval of each output from those of the inputs: an Interval, or a dict by name. Default: what the outputs
        declare.
        """
        return {}

    def start_range(self, **inputs):
        """Interval of each output at the first tick, where the proof of a loop begins, inputs not yet known being 0.
        Default: `output_range`.
        """
        return self.output_range(**inputs)

    def output_units(self, **inputs):
        """Units of outputs that differ from the rule that all "any" ports share one: a dict by name. See `free_units`
        for inputs.
        """
        return {}

    # Using a block

    def __call__(self, *signals, **named):
        """Wire the inputs, by position or by name; numbers become constants. Returns the output, or all of them."""
        where = caller()
        if self.diagram is None:
            raise DiagramError(
                Diagnostic(
                    "TW011",
                    "is wired, but was made outside a diagram",
                    path=self.path,
                    where=where,
                    hint="make and wire it inside `with Diagram(...)`; to compute one step by hand, call .step(...)",
                )
            )
        names = list(self.inputs)
        if not self.variadic and len(signals) > len(names):
            raise DiagramError(
                Diagnostic(
                    "TW012",
                    f"has {len(names)} inputs ({', '.join(names) or 'none'}), and {len(signals)} were wired",
                    path=self.path,
                    where=where,
                )
            )
        wires = [
            (None if self.variadic else name, signal) for name, signal in zip(names or [None] * len(signals), signals)
        ]
        if self.variadic:
            wires = [(None, signal) for signal in signals]
        for name, signal in wires + list(named.items()):
            if not self.variadic and name not in self.inputs:
                raise DiagramError(
                    Diagnostic(
                        "TW012",
                        f"has no input {name!r}",
                        path=self.path,
                        where=where,
                        hint=suggestion(name, names) or f"its inputs are {', '.join(names) or 'none'}",
                    )
                )
            self.diagram.wire(signal, self, name, where)
        return self.result()

    def result(self):
        """What wiring gives back: the output, a named tuple of several, or the block itself if it has none."""
        if not self.outputs:
            return self
        signals = [Signal(self, name) for name in self.outputs]
        return signals[0] if len(signals) == 1 else Outputs(self.outputs, signals)

    def step(self, *values, **named):
        """Compute one step by hand: inputs as numbers, outputs back. A native block runs its kernel on an arena of its
        own.
        """
        return self.scratch.step(values, named)

    def update(self, *values, **named):
        """Compute one update by hand, where the block has one."""
        return self.scratch.update(values, named)

    @property
    def scratch(self):
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
        """Names of the inputs with direct feedthrough, in the order the step takes them, and of the clock arguments
        among them.
        """
        if self.is_python:
            return self.arguments_of("step")
        return list(self.inputs if self.feedthrough is None else self.feedthrough)

    def update_inputs(self):
        return self.arguments_of("update") if self.has_python_update else []

    def arguments_of(self, method):
        """Names of the inputs and clock arguments that a method takes, in its order; `*inputs` takes all that it does
        not name.
        """
        names, takes_all = _arguments(getattr(type(self), method))
        return names + [name for name in self.inputs if name not in names] if takes_all else names

    def set(self, name, value):
        """Set a parameter before the compile, from command-line text or to a value. DiagramError if there is none, or
        it refuses.
        """
        if name not in self.parameters:
            raise DiagramError(
                Diagnostic(
                    "TW010",
                    f"has no parameter {name!r}",
                    path=self.path,
                    hint=suggestion(name, self.parameters) or f"it has {', '.join(self.parameters) or 'none'}",
                )
            )
        try:
            read = self.parameters[name].parse if isinstance(value, str) else self.parameters[name].check
            setattr(self, name, self.check_live(name, read(value)))
        except ValueError as error:
            raise DiagramError(
                Diagnostic("TW010", f"{name}: {error}", path=self.path, hint=self.parameters[name].description)
            ) from None
        self._configure()

    def check_live(self, name, value):
        """The value, if the parameter may have it at the start of a run too: a proof rests on its live bounds."""
        bounds = self.live_bounds.get(name)
        if bounds and not bounds.min <= value <= bounds.max:
            raise ValueError(f"must be between its live bounds {bounds.min:g} and {bounds.max:g}, got {value}")
        return value

    def live(self, name):
        """LiveBounds (min, max, slew) that a parameter keeps while running, or None if it is not live."""
        return self.live_bounds.get(name) or self.parameters[name].live_bounds

    def span(self, name):
        """Interval of a parameter: its value, or all it may become if it is live."""
        bounds = self.live(name)
        return Interval(float(bounds.min), float(bounds.max)) if bounds else Interval.point(getattr(self, name))

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
    """A recorder or a viewer: a block without outputs and without a step. Unwired, it takes every signal.

    A service in the recorder process does its work.
    """

    variadic = True
    service = ""  # name of the service in the entry-point group "tickwork.sinks", or "module:class"
    writes_files = False  # whether a run with this sink is recorded in files


def _arguments(function):
    """(names of the positional arguments after self, whether it takes any number of them). TypeError where one must be
    named.
    """
    kinds = inspect.Parameter
    parameters = list(inspect.signature(function).parameters.values())
    named = next((p.name for p in parameters if p.kind is kinds.KEYWORD_ONLY and p.default is kinds.empty), None)
    if named is not None:
        raise TypeError(f"{function.__qualname__} takes {named!r} by name only, and inputs are given by position")
    names = [p.name for p in parameters if p.kind in (kinds.POSITIONAL_ONLY, kinds.POSITIONAL_OR_KEYWORD)]
    return names[1:], any(p.kind is kinds.VAR_POSITIONAL for p in parameters)


def range_of(block, name, ranges):
    """Interval of one output, given what `output_range` returned: within what the port declares."""
    port = block.outputs[name]
    found = ranges.get(name) if isinstance(ranges, dict) else ranges
    if port.range is None:
        return EVERYTHING if found is None else found
    return port.range if found is None else found & port.range
