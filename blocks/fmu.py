"""Co-simulation FMUs (FMI 2 and 3), from OpenModelica, Dymola, Simulink and other tools."""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

import numpy as np

from blocks._plumbing.fmus import FLOATS, Slave, kind_of, limits
from blocks._plumbing.paths import file_param
from blocks._plumbing.ports import port_name, unit_and_limits
from graph import Block, Input, Output, Param, units
from graph.names import suggestion

NOT_PORTS = ("String", "Binary", "Clock")  # types of variables
STEP_TOLERANCE = 1e-6  # relative difference of a tick from a whole number of the FMU's own steps
UNIT_TOLERANCE = 1e-6  # relative difference of the factors of two equal units
PORT_LIMIT = 32  # inputs, and outputs, of a Python block
ELEMENTS_LIMIT = 10_000  # of an array


class Fmu(Block):
    """Model in a co-simulation FMU of FMI 2 or 3, such as one from OpenModelica, Dymola or Simulink.

        leg = Fmu("leg.fmu", start={"mass": 4.0}, gives={"knee.phi": ("rad", -2.0, 2.0)})

    Its inputs and outputs are ports, with name, unit, shape, minimum and maximum as in its modelDescription.xml.
    Characters that an identifier cannot have become underscores. An input that is not connected has its start value.
    Strings, binaries and clocks cannot be ports.

    A tick is a communication step. The outputs are those at its beginning, and depend on the inputs of the same tick
    that the ModelStructure of the FMU lists, or on all if it lists none. An output outside its range ends the run with
    a fault, and so does a status other than OK or warning. A NaN, an infinity or a number beyond the range of a type
    does not reach the FMU: the step is left out, and makes every output NaN. A run repeats bit for bit if the results
    of the FMU depend on its inputs and its own state alone. Requires FMPy: `pip install 'tickwork[fmi]'`.
    """

    file = file_param("FMU")
    start = Param({}, "1", "values of parameters, inputs and states at the start, as {variable: value}", dtype=dict)
    takes = Param({}, "1", "the inputs to use, as {variable: unit}; by default all", dtype=dict)
    gives = Param(
        {},
        "1",
        "the outputs to use, as {variable: unit} or {variable: (unit, lowest, highest value)}; by default all",
        dtype=dict,
    )
    delayed = Param(
        False,
        "1",
        "whether no output depends on inputs of the same tick: each is that at the end of the previous step",
        fixed=True,
    )
    step_time = Param(
        0.0,
        "s",
        "time that a step may take before the watchdog of a rig regards the tick as hung",
        min=0.0,
        max=0.5,
        fixed=True,
    )

    def configure(self) -> None:
        self.allowance = self.step_time
        try:
            self.slave = Slave(self.file)
            self.place()
            self.check_start()
            self.slave.begin(self.start)
        except ValueError as error:
            raise ValueError(f"{self.file}: {error}") from None

    def place(self) -> None:
        """Set the ports. Raises ValueError."""
        description = self.slave.description
        bases = {each.name: each.baseUnit for each in description.unitDefinitions}
        self.inputs, self.outputs = {}, {}
        taken = self.chosen("takes", "input")
        self.inputs = {
            port: Input(
                unit_of(each, self.takes.get(each.name), bases),
                each.description or "input of the FMU",
                shape=each.shape,
                dtype=dtype_of(each),
                default=self.start.get(each.name, start_of(each)),
            ).named(port)
            for port, each in taken.items()
        }
        given = self.chosen("gives", "output")
        for port, each in given.items():
            unit, limit = unit_and_limits(each.name, self.gives[each.name]) if self.gives else (None, None)
            self.outputs[port] = Output(
                unit_of(each, unit, bases),
                each.description or "output of the FMU",
                shape=each.shape,
                dtype=dtype_of(each),
                range=range_of(each, limit),
            ).named(port)
        used = {each.variable.name: each.dependencies for each in description.outputs}
        lists = [used.get(each.name) for each in given.values()]  # None: of unknown inputs
        self.direct = {
            port: each
            for port, each in taken.items()
            if not self.delayed and any(x is None or each in x for x in lists)
        }
        self.to_step = self.slave.transfers(list(self.direct.values()))
        self.to_update = self.slave.transfers(list(taken.values()))
        self.from_step = self.slave.transfers(list(given.values()))
        self.lost: list[Any] = [np.full(each.shape, math.nan) if each.shape else math.nan for each in given.values()]
        self.finite = True

    def chosen(self, stated: str, causality: str) -> dict[str, Any]:
        """Return the variables of the inputs or outputs, by name of the port. stated : "takes" or "gives" """
        names, variables = getattr(self, stated), self.slave.description.modelVariables
        check_known(stated, names, variables)
        ports: dict[str, Any] = {}
        for each in variables:
            usable = each.causality == causality and each.type not in NOT_PORTS and not each.clocks
            if not (each.name in names if names else usable):
                continue
            if not usable:
                kind = f"{each.variability} {each.causality} of the type {each.type}"
                raise ValueError(f"{stated}: {each.name} is a {kind}, and cannot be an {causality} of the block")
            if math.prod(each.shape) > ELEMENTS_LIMIT:
                raise ValueError(
                    f"{each.name} is an array of the shape {each.shape}, and a port has at most {ELEMENTS_LIMIT} "
                    f"elements: list other {causality}s in {stated}"
                )
            port = port_name(each.name, _RESERVED_NAMES, "_port")
            if port in ports or port in self.inputs:
                raise ValueError(f"two variables would be the port {port}: list one of them in {stated}")
            ports[port] = each
        if len(ports) > PORT_LIMIT:
            raise ValueError(
                f"it has {len(ports)} {causality}s, and a block at most {PORT_LIMIT}: list some in {stated}"
            )
        return ports

    def check_start(self) -> None:
        """Raise ValueError for a value that its variable cannot have, and for a variable that cannot be set."""
        check_known("start", self.start, self.slave.description.modelVariables)
        for each in self.slave.description.modelVariables:
            if each.name not in self.start:
                continue
            exact = each.initial in ("exact", "approx") and each.variability != "constant"
            if each.causality == "structuralParameter" or each.causality != "input" and not exact:
                raise ValueError(f"start: {each.name} cannot be set, it is a {each.variability} {each.causality}")
            if each.type in NOT_PORTS:
                continue
            value, (low, high) = self.start[each.name], limits(kind_of(each, self.slave.version))
            if (declared := range_of(each)) is not None:
                low, high = max(low, declared[0]), min(high, declared[1])
            numbers = np.asarray(value)
            if numbers.dtype.kind not in "bif" or numbers.shape != each.shape:
                shape = f"an array of the shape {each.shape}" if each.shape else "a number"
                raise ValueError(f"start: {each.name} must be {shape}, got {value!r}")
            if not np.all((numbers >= low) & (numbers <= high)):
                raise ValueError(f"start: {each.name} must be from {low:g} to {high:g}, got {value!r}")

    def prepare(self, dt: float) -> None:
        """Check the step of an FMU that has one. Raises ValueError."""
        interface = self.slave.interface
        own = 0.0 if interface.canHandleVariableCommunicationStepSize else float(interface.fixedInternalStepSize or 0.0)
        if own and (round(dt / own) < 1 or abs(round(dt / own) * own - dt) > STEP_TOLERANCE * dt):
            raise ValueError(f"the step of {self.file}, {own:g} s, does not divide the tick of the block, {dt:g} s")

    def reset(self) -> None:
        """Return to the state of the start, in a new instance if this one has run."""
        super().reset()
        self.slave.begin(self.start)
        self.finite = True

    def step_inputs(self) -> list[str]:
        """Return the names of the inputs with direct feedthrough."""
        return list(self.direct)

    def step(self, *inputs: Any) -> Any:
        """Return the outputs at the present communication point."""
        outputs = self.lost.copy()
        if self.finite and self.slave.write(self.to_step, inputs):
            self.slave.read(self.from_step, outputs)
        elif whole := [name for name, port in self.outputs.items() if port.dtype != "float"]:
            raise ArithmeticError(f"an input is NaN, infinite or beyond its type, and {', '.join(whole)} cannot be NaN")
        return outputs if len(outputs) > 1 else outputs[0] if outputs else None

    def update(self, dt: float, *inputs: Any) -> None:
        """Compute the communication step that begins at this tick."""
        self.finite = self.slave.write(self.to_update, inputs)
        if self.finite:
            varies = self.slave.interface.canHandleVariableCommunicationStepSize
            self.slave.advance(dt if varies or self.dt is None else self.dt)


def check_known(stated: str, names: Iterable[str], variables: list[Any]) -> None:
    """Raise ValueError for a name that no variable has. stated : the parameter with the names"""
    known = [each.name for each in variables]
    for name in names:
        if name not in known:
            raise ValueError(f"{stated}: it has no variable {name!r}. {suggestion(name, known)}".rstrip(". "))


def dtype_of(variable: Any) -> str:
    """Return the dtype of the port of a variable."""
    return "float" if variable.type in FLOATS else "bool" if variable.type == "Boolean" else "int"


def declared(variable: Any, name: str) -> Any:
    """Return an attribute of a variable, or that of its declared type. None if neither has it."""
    value = getattr(variable, name)
    return getattr(variable.declaredType, name, None) if value is None else value


def start_of(variable: Any) -> Any:
    """Return the start value that the FMU declares, or None."""
    if variable.start is None:
        return None
    numbers = [float({"true": 1, "false": 0}.get(word, word)) for word in str(variable.start).split()]
    return np.array(numbers).reshape(variable.shape) if variable.shape else numbers[0]


def range_of(variable: Any, limit: tuple[float, float] | None = None) -> tuple[float, float] | None:
    """Return the range that the FMU declares, within further limits. None for no range."""
    low, high = (declared(variable, name) for name in ("min", "max"))
    if limit is None and low is None and high is None:
        return None
    low, high = -math.inf if low is None else float(low), math.inf if high is None else float(high)
    return (low, high) if limit is None else (max(low, limit[0]), min(high, limit[1]))


def unit_of(variable: Any, stated: str | None, bases: dict[str, Any]) -> str:
    """Return the unit of a variable. stated : in takes or gives; bases : BaseUnit by name of a unit. ValueError"""
    name = declared(variable, "unit")
    if not name:
        return units.canonical(stated or units.ONE)
    base, known = bases.get(name), None
    with suppress(ValueError):
        known = units.canonical(name)
    if known is None or not agrees(known, base):
        known = units.ONE if base is not None and agrees(units.ONE, base) else None
    if known is None and (stated is None or not agrees(stated, base)):
        got = "" if stated is None else f", and it is not {stated}"
        raise ValueError(
            f"{variable.name} has the unit {name!r}, which Tickwork does not have{got}: state an equal one in takes or "
            "gives, or export the FMU with an SI unit"
        )
    if known and stated and units.canonical(stated) != known:
        raise ValueError(f"{variable.name} has the unit {known} in the FMU, and {stated} is stated")
    return known or units.canonical(stated or units.ONE)


def agrees(unit: str, base: Any) -> bool:
    """Return whether a unit is as the BaseUnit of FMI defines it. Some tools regard rad as a number, some as a unit."""
    if base is None:
        return True
    factor, powers = units.scale(unit)
    offset = units.convert(0.0, "°C", "K") if unit == "°C" else 0.0
    return (
        all(powers.get(symbol, 0) == getattr(base, symbol) for symbol in ("kg", "m", "s", "A", "K", "mol", "cd"))
        and math.isclose(factor, base.factor, rel_tol=UNIT_TOLERANCE)
        and math.isclose(offset, base.offset, rel_tol=UNIT_TOLERANCE)
    )


_RESERVED_NAMES = {
    *dir(Fmu),
    *Fmu.parameters,
    "self",  # arguments of methods
    "dt",
    "slave",
    "direct",
    "to_step",
    "to_update",
    "from_step",
    "finite",
    "allowance",
}
