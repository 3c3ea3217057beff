"""Controllers in shared libraries, from Simulink Coder, C, C++ or Rust."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

from blocks._plumbing.paths import file_param
from blocks._plumbing.ports import check_port_names, unit_and_limits
from cext.kernels import compiled as kernels
from graph import Block, Input, Memory, Output, Param, units
from graph.declarations import Port


class Compiled(Block):
    """Controller in a shared library with the three C functions of `tickwork.h`.

        spring = Compiled(
            "spring.so",
            takes={"angle": "rad", "velocity": "rad/s"},
            gives={"torque": ("N·m", -12.0, 12.0)},
        )(angle=knee.position, velocity=knee.velocity)

    Or a subclass declares the ports, with descriptions and shapes. Each block has a copy of the library, and so state,
    of its own. Every run starts with `tickwork_init`.

    A NaN or infinity at an input does not reach the library, and makes every output NaN. An output of the library that
    is NaN, infinite or outside its range ends the run with a fault, and so does a step that returns another number
    than 0. A run repeats bit for bit if the library's results depend on its inputs and its own state alone.
    """

    file = file_param("library")
    takes = Param({}, "1", "inputs, as {name: unit}, in the order of the library", dtype=dict)
    gives = Param({}, "1", "outputs, as {name: unit} or {name: (unit, lowest, highest value)}", dtype=dict)

    state = Memory(0.0, "address of the controller")
    count = Memory(0.0, "steps of the library since the start")
    kernel = kernels.step

    def configure(self) -> None:
        check_port_names([*self.takes, *self.gives], _RESERVED_NAMES)
        self.inputs = type(self).inputs | {
            name: Input(unit, "input of the controller").named(name) for name, unit in self.takes.items()
        }
        self.outputs = type(self).outputs | {name: output(name, stated) for name, stated in self.gives.items()}
        with open(self.file, "rb") as file:
            if file.read(4) != b"\x7fELF":
                raise ValueError(
                    f"{self.file}: it is not a shared library: compile one with `gcc -shared -fPIC`, and name that file"
                )
        try:
            self.library = kernels.Library(Path(self.file).read_bytes())
        except ValueError as error:
            raise ValueError(f"{self.file}: {error}") from None
        for what, ports, count in (
            ("inputs", self.inputs, self.library.inputs),
            ("outputs", self.outputs, self.library.outputs),
        ):
            declared = sum(map(size, ports.values()))
            if declared != count:
                names = ", ".join(ports) or "none"
                raise ValueError(f"{self.file} has {count} {what}, and {declared} are declared: {names}")
        self.elements = [(port, text) for port in self.outputs.values() for text in elements(port)]
        self.state = self.library.address
        self.kernel = kernels.step.owned(self.library)

    def prepare(self, dt: float) -> None:
        """Set the state of the start. Raises ValueError if the library refuses."""
        if code := self.library.start(dt, [bounds(port) for port, _ in self.elements]):
            raise ValueError(f"{self.file}: tickwork_init({dt:g}) returned {code}")

    def fault_text(self, status: int) -> str:
        """Return the text of a status of the kernel."""
        if status < kernels.OUTSIDE:
            return {
                kernels.IN_USE: "two programs use its library at the same time",
                kernels.NOT_STARTED: f"tickwork_init returned {self.library.code}",
                kernels.FAILED: f"tickwork_step returned {self.library.code}",
            }[status]
        port, text = self.elements[status - kernels.OUTSIDE]
        low, high, whole = bounds(port)
        allowed = "a whole number" if whole else "a finite number"
        if -sys.float_info.max < low or high < sys.float_info.max:
            allowed += f" from {low:g} to {high:g}"
        unit = "" if port.unit in (units.ONE, units.ANY) else f" {port.unit}"
        return f"its library computed {text} = {self.library.result(status - kernels.OUTSIDE):g}{unit}, not {allowed}"


def output(name: str, stated: Any) -> Output:
    """Return the Output of an entry of `gives`. Raises ValueError."""
    unit, limits = unit_and_limits(name, stated)
    port = Output(unit, "output of the controller", range=limits)
    return port.named(name)


def size(port: Port) -> int:
    """Return the number of elements of a port. Raises ValueError if it can have any."""
    if port.shape is ...:
        raise ValueError(f"{port.name} must have a declared number of elements, as in shape=(3,)")
    return math.prod(port.shape)


def elements(port: Output) -> list[str]:
    """Return the name of each element of an output."""
    return [port.name] if port.shape == () else [f"{port.name}[{index}]" for index in range(size(port))]


def bounds(port: Output) -> tuple[float, float, bool]:
    """Return the lowest and highest finite value of an output, and whether it must be whole."""
    if port.dtype == "bool":
        return 0.0, 1.0, True
    limit, declared = sys.float_info.max, port.range
    low, high = (declared.low, declared.high) if declared else (-limit, limit)
    return max(low, -limit), min(high, limit), port.dtype == "int"


_RESERVED_NAMES = {*dir(Compiled), *Compiled.parameters, "library", "elements"}
