"""Blocks: a class with declared ports and parameters, and a step in Python or a native kernel."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, TypedDict

from cext.rules import Rule
from cext.user_text import name_and_text, repr_of, text_of
from graph import hints
from graph.class_checks import arguments_of, check_class, wrong_attributes
from graph.declarations import Declaration, Declared, Input, Live, LiveBounds, Memory, Output, Param
from graph.diagnostics import Diagnostic, DiagramError, caller
from graph.diagram import current_scope, is_count, note_stray
from graph.files import path_beside
from graph.interval import EVERYTHING, Interval
from graph.kernel_items import check_kernels, replace_kernels
from graph.names import count, snake_case, suggestion
from graph.narrowing import is_table
from graph.rules import DT, bound, held_bounds_of, rules_of
from graph.scratch import Scratch
from graph.signal import Outputs, Signal


class BlockOptions(TypedDict, total=False):
    """Keyword arguments of every block."""

    name: str | None
    every: int
    hold_exceptions: int


class Block:
    """Base class of all blocks.

    A Python block defines `step(self, *inputs)`, called with floats (vectors: read-only views, valid during the call);
    it returns the outputs. Inputs that `step` does not take have no direct feedthrough. With state it may have
    `update(self, *inputs)`, run at the end of the tick, `reset()`, and `settle(self, *inputs)`, which sets the steady
    state of the present inputs when the robot is armed. A step may also take `t`, `tick` and `dt`.

    A native block names a `kernel`, and `update_kernel` and `settle_kernel` where it needs them; `feedthrough` names
    the inputs its kernel reads, all by default. A kernel names its items (cext/kernel.py), and the class declares each
    of them, among others; a `step` in Python replaces inherited kernels.

    Hooks: `configure()` after the parameters are set; `prepare(dt)` when the sampling period is known; `output_range`
    for the proof; `output_units` where outputs have units of their own; `fault_text` for a status of its kernel;
    `run_summary`. `rules` relate parameters, as in ("lower <= upper",), and also hold for live ones (graph/rules.py).
    """

    kernel: Any = None
    update_kernel: Any = None
    settle_kernel: Any = None
    feedthrough: Iterable[str] | None = None
    rules: tuple[str, ...] = ()  # comparisons between parameters; those of base classes also hold
    # {output or memory: (low, high)}, expressions as those of a rule, as in {"limited": ("-limit", "limit")}: bounds of
    # what the block keeps while it does not run. A live change moves it towards 0, never away from it
    held_within: dict[str, tuple[str, str]] = {}
    inputs: dict[str, Input] = {}
    outputs: dict[str, Output] = {}
    parameters: dict[str, Param[Any]] = {}
    memory: dict[str, Memory] = {}
    positional: tuple[str, ...] | None = None  # parameters that may be passed by position, in order; None: all
    free_units: tuple[str, ...] = ()  # "any" inputs that need not share the one unit of the others
    variadic: bool = False  # takes any number of signals
    width: int = 1  # elements of its `...` ports, once it is known
    every: int = 1  # runs at every n-th tick
    # consecutive steps that may raise while the outputs keep their last values; 0: the first exception is a fault
    hold_exceptions: int = 0
    conditions: tuple[Signal, ...] = ()  # signals that must all be true for it to run
    resamples: bool = False  # may connect rates that do not divide, as Hold does
    models_heat: bool = False  # estimates the temperature of an actuator that does not report it
    always: bool = False  # must run in every tick: in no slower subsystem, and in none that may be disabled
    abstract: bool = False  # a base class, in no list of blocks; not inherited
    allowance: float = 0.0  # s that its step may take in addition to the limits of watchdog and guardian for a tick
    smooth: tuple[str, ...] = ()  # inputs at which a jump of a periodic value gives wrong outputs, as in a filter
    passes_jumps: bool = False  # an input appears in its outputs unchanged, or multiplied, or added to others
    clips: bool = False  # a limiter, whose output range is the values that it passes
    winds_up: Mapping[
        str, str
    ] = {}  # outputs that integrate an error beyond limits behind them: inputs that track these
    output_slew: Any = None  # fastest change of its output per second, where the block bounds it
    jit: bool = False  # compile the step to a kernel, where Numba is installed
    continuous: bool = False  # has continuous states: graph/continuous.py
    compiled: bool = False  # the step has been compiled to a kernel
    diagram: Any = None
    path: str = ""
    dt: Any  # s, the block's own sampling period; None until it is known
    location: Any  # Location of the line that made the block, or None
    live_bounds: dict[str, Any]
    set_from: dict[str, tuple[str, Any]]  # parameter set from outside the diagram: (source, value in the diagram)
    examples: ClassVar[Iterable[dict[str, Any]]]  # parameters of blocks that the conformance test builds
    settle: ClassVar[Callable[..., Any]]
    _scratch: Scratch | None = None
    _rules: ClassVar[list[Rule]] = []
    _files: ClassVar[tuple[str, ...]] = ()  # parameters that are paths of files
    _own: ClassVar[dict[str, Param[Any]]] = {}  # parameters that the class itself declares

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        cls._own = {n: d for n, d in vars(cls).items() if isinstance(d, Param)}
        for name in cls._own:
            # CPython 3.11 is slow to find an attribute that the class also has: a step would take a quarter longer
            delattr(cls, name)
        declared: dict[str, Any] = {}
        for base in reversed(cls.__mro__):
            names = vars(base) | vars(base).get("_own", {})
            declared.update({n: d for n, d in names.items() if isinstance(d, Declaration) or n in declared})
        for kind, field in ((Input, "inputs"), (Output, "outputs"), (Param, "parameters"), (Memory, "memory")):
            of_kind: dict[str, Any] = {n: d for n, d in declared.items() if isinstance(d, kind)}
            setattr(cls, field, Declared(of_kind))
        check_class(cls, declared, _WORDS)
        if cls.positional is not None:
            first = {name: cls.parameters[name] for name in cls.positional}
            cls.parameters = Declared({**first, **cls.parameters})
        if cls.step is not Block.step:
            replace_kernels(cls)
        check_kernels(cls)
        cls._rules = rules_of(cls)
        cls._files = tuple(name for name, param in cls.parameters.items() if param.file)
        held_bounds_of(cls, cls.held_within)

    def __init__(
        self, *values: Any, name: str | None = None, every: int = 1, hold_exceptions: int = 0, **named: Any
    ) -> None:
        self.dt = None
        self.location = caller()
        self.live_bounds = {}
        self.set_from = {}
        self.every, self.hold_exceptions = every, hold_exceptions
        self._set_parameters(values, named)
        scope = current_scope()
        if scope is not None:
            scope.adopt(self, name)
        else:
            self.path = name or snake_case(type(self).__name__)
            note_stray(self)
        try:
            self.reconfigure()
            if self.is_python and (self.dt is not None or type(self).prepare is Block.prepare):
                self._attempt(self.prepare, self.dt)
                self.reset()
        except BaseException:
            if self.diagram is not None:
                self.diagram.discard(self)
            raise
        self._attributes = len(vars(self)) + 1

    def _set_parameters(self, values: tuple[Any, ...], named: dict[str, Any]) -> None:
        """Check and set the parameters. Raises DiagramError with all problems."""
        problems: list[Diagnostic] = []

        def wrong(message: str, hint: str = "", code: str = "TW010") -> None:
            problems.append(Diagnostic(code, message, path=type(self).__name__, where=self.location, hint=hint))

        signal = next((value for value in (*values, *named.values()) if isinstance(value, Signal)), None)
        if signal is not None and not named.keys() & self.inputs.keys():
            wrong(f"the signal {signal.path} was passed as a parameter", hints.in_second_parentheses(self))
            raise DiagramError(problems)
        given = self._named_values(values, named, wrong)
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
                wrong(f"{key}: {text_of(error)}", param.description)
        for each in self._wrong_options():
            wrong(*each)
        if problems:
            raise DiagramError(problems)

    def _named_values(
        self, values: tuple[Any, ...], named: dict[str, Any], wrong: Callable[[str, str], None]
    ) -> dict[str, Any]:
        """Return the given parameters by name. wrong : function that receives what no parameter takes, and a hint"""
        names = list(self.parameters if self.positional is None else self.positional)
        if len(values) > len(names):
            by_position = "" if self.positional is None else " by position"
            wrong(
                f"takes {count(names, 'parameter')}{by_position} ({', '.join(names) or 'none'}), got {len(values)}",
                by_position and "pass the others by name",
            )
        given = dict(zip(names, values))
        for key, value in named.items():
            if key not in self.parameters:
                wrong(f"has no parameter {key!r}", hints.for_parameter(self, key))
            elif key in given:
                wrong(f"{key} was given twice", "")
            else:
                given[key] = value
        return given

    def _wrong_options(self) -> Iterator[tuple[str, str, str]]:
        """Yield (message, hint, code) for what is wrong with `every` and `hold_exceptions`."""
        if not is_count(self.every):
            yield (
                f"every must be a whole number of ticks, 1 or more, got {repr_of(self.every)}",
                "every=2 runs the block in every second tick",
                "TW014",
            )
        if not (is_count(self.hold_exceptions) or (type(self.hold_exceptions) is int and self.hold_exceptions == 0)):
            yield (
                f"hold_exceptions must be a whole number of steps in a row, got {repr_of(self.hold_exceptions)}",
                "0: the first exception is a fault",
                "TW010",
            )
        elif self.hold_exceptions and not (self.is_python or self.has_python_update):
            message = "does not accept hold_exceptions, since it does not run in Python"
            yield message, "omit hold_exceptions", "TW010"

    def reconfigure(self) -> None:
        """Check the rules of the present parameters, find files, and call `configure`. Raises DiagramError TW010."""
        if self._files:
            self._attempt(self._find_files)
        if self._rules:
            self._attempt(self.check_rules)
        self._attempt(self.configure)
        self._configured = {name: getattr(self, name) for name in self.parameters}
        self._ports = {name: getattr(self, name).keys() for name in ("inputs", "outputs", "parameters")}
        if self.kernel is not None and type(self).kernel is None and not self.compiled:
            raise TypeError(
                f"{type(self).__name__} chooses its kernel in configure: also name one of them on the class, so that "
                "its subclasses are checked against it"
            )
        for name in self.outputs:
            if not hasattr(self, name):
                setattr(self, name, Signal(self, name))  # of an output that the parameters have made
            elif not isinstance(getattr(self, name), Signal):
                message, hint = hints.for_taken_output(self, name)
                raise self._error("TW010", message, self.location, hint)

    def _find_files(self) -> None:
        """Replace the path of each file that a parameter names by its absolute path. Raises ValueError."""
        for name in self._files:
            if (file := getattr(self, name)) or self.parameters[name].required:
                try:
                    setattr(self, name, str(path_beside(self.location, file)))
                except ValueError as error:
                    raise ValueError(f"{name}: {error}") from None

    # What a block's author may define

    # Hooks take `*_: Any` so that an override may name its inputs.

    def configure(self) -> None:
        """Derive attributes that do not depend on the sampling period. Called when the parameters are set."""

    def prepare(self, dt: float) -> None:
        """Set memory that depends on the sampling period dt, in s. Called when it is known."""

    def reset(self) -> None:
        """Return to the state before the first step."""
        self._scratch = None

    def output_range(self, *_: Any, **inputs: Any) -> Any:
        """Return the Interval of each output, given those of the inputs by name.

        Returns an Interval, or a dict of them by name of output. Default: the declared ranges.
        """
        return {}

    def start_range(self, *_: Any, **inputs: Any) -> Any:
        """Return the Interval of each output at the first tick, where the proof of a loop begins.

        Inputs that are not yet known are 0. Default: `output_range`.
        """
        return self.output_range(**inputs)

    def instability(self) -> tuple[str, str] | None:
        """Return (the reason why the output grows without bound, the remedy), or None. A compile warns of it."""
        return None

    def fault_text(self, status: int) -> str:
        """Return what a status of the block's own kernel reports, or "". status : at least cext.abi.FIRST_OWN_STATUS"""
        return ""

    def run_summary(self) -> str:
        """Return figures of the finished run for its summary, or ""."""
        return ""

    def output_units(self, *_: Any, **inputs: Any) -> dict[str, str]:
        """Return units of outputs, by name, that differ from the one unit that all "any" ports share.

        inputs : units by name; `free_units` lists the inputs that need not share it
        """
        return {}

    def files_of(self, name: str) -> list[Path]:
        """Return the files whose content is part of the diagram, for a parameter with a path. name : its name"""
        return [Path(getattr(self, name))]

    # Using a block

    def __call__(self, *signals: Any, **named: Any) -> Any:
        """Wire the inputs, by position or by name; numbers become constants.

        Returns the output's Signal, a named tuple of several, or the block if it has none. Raises DiagramError for a
        block outside a diagram, an unknown input, and a value that is neither a signal nor a number.
        """
        where = caller()
        if self.diagram is None:
            raise self._error(
                "TW011",
                "was created outside a diagram and cannot be connected",
                where,
                "create and connect it inside `with Diagram(...)`; to compute a single step, call .step(...)",
            )
        names = list(self.inputs)
        if not self.variadic and len(signals) > len(names):
            found = f"has {count(names, 'input')} ({', '.join(names) or 'none'}), got {count(signals, 'signal')}"
            raise self._error("TW012", found, where, hints.for_count(self))
        wires = [(None, signal) for signal in signals] if self.variadic else list(zip(names, signals))
        for name, signal in [*wires, *named.items()]:
            if not self.variadic and name not in self.inputs:
                raise self._error("TW012", f"has no input {name!r}", where, hints.for_input(self, name))
            self.diagram.wire(signal, self, name, where)
        return self.result()

    def result(self) -> Any:
        """Return the output's Signal, a named tuple of several, or the block if it has none."""
        if not self.outputs:
            return self
        signals = [Signal(self, name) for name in self.outputs]
        return signals[0] if len(signals) == 1 else Outputs(self.outputs, signals)

    def step(self, *values: Any, **named: Any) -> Any:
        """Compute one step: inputs and outputs are numbers or arrays.

        A native block runs its kernel on an arena of its own. Raises TypeError for an unknown or missing input.
        """
        return self.scratch.step(values, named)

    def update(self, *values: Any, **named: Any) -> Any:
        """Compute one update, if the block has one."""
        return self.scratch.update(values, named)

    @property
    def computes_alone(self) -> bool:
        """Whether it may be of use outside a diagram, by its step()."""
        return self._scratch is not None or (self.is_python and bool(self.outputs))

    @property
    def scratch(self) -> Scratch:
        """The arena on which `step` runs a native block."""
        if self._scratch is None:
            self._scratch = Scratch(self)
        return self._scratch

    @property
    def is_python(self) -> bool:
        """Whether the step runs in Python."""
        return type(self).step is not Block.step and not self.compiled

    @property
    def has_python_update(self) -> bool:
        """Whether the update runs in Python."""
        return type(self).update is not Block.update and not self.compiled

    def step_inputs(self) -> list[str]:
        """Return the names of the inputs with direct feedthrough and of clock arguments, in the order of the step."""
        if self.is_python:
            return self.arguments_of("step")
        return list(self.inputs if self.feedthrough is None else self.feedthrough)

    def update_inputs(self) -> list[str]:
        """Return the names of the inputs and clock arguments of an update in Python."""
        return self.arguments_of("update") if self.has_python_update else []

    def arguments_of(self, method: str) -> list[str]:
        """Return the names of the inputs and clock arguments of a method, in its order.

        `*inputs` stands for all inputs that the method does not name.
        """
        names, takes_all = arguments_of(getattr(type(self), method))
        return names + [name for name in self.inputs if name not in names] if takes_all else names

    def set(self, name: str, value: Any, source: str = "") -> None:
        """Set a parameter before the compile, to a value or from command-line text.

        source : where the value is from, such as the name of a rig file; "" for the diagram

        Raises DiagramError TW010 for an unknown parameter and for a value outside its type, bounds, choices or rules.
        """
        self.put(name, value, source)
        self.reconfigure()

    def put(self, name: str, value: Any, source: str = "") -> None:
        """Set a parameter as `set` does, without its rules, for several together: call `reconfigure` after them."""
        if name not in self.parameters:
            hint = suggestion(name, self.parameters) or f"it has {', '.join(self.parameters) or 'none'}"
            raise self._error("TW010", f"has no parameter {name!r}", None, hint)
        param = self.parameters[name]
        before = self.set_from.get(name, ("", getattr(self, name)))[1]
        self._assign(name, param.parse if isinstance(value, str) else param.check, value)
        self.set_from.pop(name, None)
        if source:
            self.set_from[name] = source, before

    def adopt_assigned(self) -> None:
        """Check the parameters whose attributes were assigned since `configure`, and call it again with them.

        Raises DiagramError as `set` does.
        """
        for wrong in wrong_attributes(vars(self)):
            raise self._error("TW010", wrong, self.location, "remove the assignment: only parameters can be assigned")
        for name, ports in self._ports.items():
            if getattr(self, name).keys() != ports:
                hint = "assign them in the method `configure` of its class"
                raise self._error("TW010", f"its {name} were assigned", self.location, hint)
        for message, hint, code in self._wrong_options():
            raise self._error(code, message, self.location, hint)
        assigned = [name for name, value in self._configured.items() if getattr(self, name, None) is not value]
        for name in assigned:
            self._assign(name, self.parameters[name].check, getattr(self, name, None))
        if assigned:
            self.reconfigure()

    def _assign(self, name: str, read: Callable[[Any], Any], value: Any) -> None:
        """Set a parameter to what `read`, of its Param, makes of a value. Raises DiagramError TW010."""
        try:
            setattr(self, name, self.check_live(name, read(value)))
        except (ValueError, TypeError, OverflowError) as error:
            hint = self.parameters[name].description
            raise self._error("TW010", f"{name}: {text_of(error)}", self.location, hint) from None

    def assigned_names(self) -> list[str]:
        """Return the names of public attributes that were added after a native block was made, except its memory."""
        if len(vars(self)) <= self._attributes or self.is_python or self.has_python_update:
            return []
        return [
            name
            for name in list(vars(self))[self._attributes :]
            if not (name.startswith("_") or name in self.memory or hasattr(type(self), name))
        ]

    def check_live(self, name: str, value: Any) -> Any:
        """Return the value. Raises ValueError outside the parameter's live bounds, which the proof uses."""
        bounds = self.live_bounds.get(name)
        if bounds and not bounds.min <= value <= bounds.max:
            raise ValueError(f"must be between its live bounds {bounds.min:g} and {bounds.max:g}, got {value}")
        return value

    def live(self, name: str) -> LiveBounds | None:
        """Return the bounds and the slew of a live parameter, or None if it is not live."""
        return self.live_bounds.get(name) or self.parameters[name].live_bounds

    def span(self, name: str) -> Interval:
        """Return the Interval of a parameter: its live bounds, within its rules, or its value if it is not live."""
        span = self._live_span(name)
        if self._rules and self.live(name):
            for rule in self.applying_rules():
                span &= bound(rule, name, self._live_span)
        return span

    def _live_span(self, name: str) -> Interval:
        bounds = None if name == DT else self.live(name)
        return Interval(float(bounds.min), float(bounds.max)) if bounds else Interval.point(getattr(self, name))

    def applying_rules(self) -> list[Rule]:
        """Return the rules whose parameters all have values."""
        return [rule for rule in self._rules if all(getattr(self, key) is not None for key in rule.keys)]

    def check_rules(self) -> None:
        """Raise ValueError if the parameters violate a rule between them."""
        for rule in self.applying_rules():
            if not rule.holds(self.__getattribute__):
                raise ValueError(rule.sentence(self.__getattribute__))

    def _attempt(self, method: Callable[..., Any], *arguments: Any) -> Any:
        """Call a hook. Errors of values and files become a DiagramError at the line that made the block."""
        try:
            return method(*arguments)
        except OSError as error:
            message = text_of(error) if error.strerror is None else f"cannot read {error.filename}: {error.strerror}"
            raise self._error("TW010", message, self.location, hints.for_file(error)) from None
        except (ValueError, ZeroDivisionError, FloatingPointError) as error:
            raise self._error("TW010", text_of(error), self.location) from None
        except (TypeError, LookupError, AttributeError, ArithmeticError) as error:
            if type(self).__module__.partition(".")[0] not in _LIBRARY:
                raise  # at its line in the user's class
            given = {name: getattr(self, name) for name in self.parameters}
            shown = [f"{n}={repr_of(v)}" for n, v in given.items() if v is not self.parameters[n].default]
            message = f"cannot be made with {', '.join(shown)}"
            raise self._error("TW010", f"{message}: {name_and_text(error)}", self.location) from error

    def _error(self, code: str, message: str, where: Any, hint: str = "") -> DiagramError:
        """Return the error of this block. where : Location, or None"""
        return DiagramError(Diagnostic(code, message, path=self.path, where=where, hint=hint))

    def __dir__(self) -> list[str]:
        """Return the names to complete: ports, parameters, the steps, and what a class of the user's adds."""
        own = [kind for kind in type(self).__mro__ if kind.__module__.partition(".")[0] not in _LIBRARY]
        added = {name for kind in own for name in vars(kind) if not name.startswith("_") and name not in _WORDS}
        return [*{*self.outputs, *self.inputs, *self.parameters, *added, *_COMPLETED}]

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.path}>"


# names that a declaration must not override
_WORDS = {word for word in vars(Block) if not word.startswith("_")} | {"name", "dt", "every", "location", "settle"}
_LIBRARY = ("blocks", "builtins", "graph")  # packages whose attributes other than declarations are not completed
_COMPLETED = ("dt", "path", "reset", "set", "step", "update")


class Sink(Block):
    """A recorder or a viewer: a block without outputs and without a step. Unwired, it takes every signal.

    A service in the recorder process does its work.
    """

    variadic = True
    service: str = ""  # name of the service in the entry-point group "tickwork.sinks", or "module:class"
    writes_files: bool = False  # whether a run with this sink is recorded in files
    accepts_every: bool = False  # whether it takes the samples of every n-th tick only, with every=n

    def is_active(self, virtual: bool) -> bool:
        """Return whether this sink receives a run. virtual : whether the run is in virtual time"""
        return True


def are_ranges(result: object) -> bool:
    """Return whether a hook has returned an Interval, a dict of them, or None."""
    found = result.values() if is_table(result) else [EVERYTHING if result is None else result]
    return all(isinstance(interval, Interval) for interval in found)


def range_of(block: Block, name: str, ranges: Interval | dict[str, Interval] | None) -> Interval:
    """Return the Interval of an output: the result of `output_range`, within the range that the port declares."""
    port = block.outputs[name]
    found = ranges.get(name) if isinstance(ranges, dict) else ranges
    if port.range is None:
        return EVERYTHING if found is None else found
    return port.range if found is None else found & port.range
