"""Instances of co-simulation FMUs, loaded by FMPy."""

from __future__ import annotations

import ctypes
import importlib
import importlib.util
import io
import math
import os
import re
import shutil
import sys
import weakref
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from functools import partial
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, NamedTuple

import numpy as np

from blocks._plumbing.fmu_archive import check_sizes, is_used

EXTRA = "pip install 'tickwork[fmi]'"
STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
ERROR, FATAL = 3, 4
FLOATS = {"Real": sys.float_info.max, "Float64": sys.float_info.max, "Float32": float(np.finfo(np.float32).max)}


class Transfer(NamedTuple):
    """Variables of one type, which one call of the FMU sets or gets.

    kind : as in fmi2Set{kind}; limits : lowest and highest number; references, numbers : arrays of ctypes
    places : (index of the port, shape) of each variable
    """

    kind: str
    limits: tuple[float, float]
    references: Any
    numbers: Any
    places: list[tuple[int, tuple[int, ...]]]


class Slave:
    """FMU in a folder of its own, and so with static variables of its own. Raises ValueError for an unusable one.

    file : path of the FMU
    """

    def __init__(self, file: str) -> None:
        self.fmpy = library()
        self.folder = mkdtemp(prefix="tickwork-fmu-")
        weakref.finalize(self, remove, self.folder, os.getpid())
        check_sizes(file, self.folder)
        try:
            self.fmpy.extract(file, self.folder, is_used)
            self.description = self.fmpy.read_model_description(self.folder)
        except Exception as error:  # FMPy's own are of no other class
            raise ValueError(f"it is not an FMU that can be read: {error}") from None
        self.version, self.interface = int(self.description.fmiVersion[0]), self.description.coSimulation
        if self.version == 1:
            raise ValueError("it is of FMI 1: export it as a co-simulation FMU of FMI 2 or 3")
        if self.interface is None:
            raise ValueError("it is not for co-simulation: export it as a co-simulation FMU")
        self.binary = self.find_binary(Path(self.folder, "binaries"))
        self.log: list[str] = []
        self.fresh, self.time = False, 0.0
        self.fmu: Any = None
        self.end: Callable[[], Any] = lambda: None

    def find_binary(self, folder: Path) -> Path:
        """Return the path of the shared library for this computer. Raises ValueError."""
        name = f"{self.interface.modelIdentifier}.so"
        platforms = [self.fmpy.platform_tuple, self.fmpy.platform]  # the names of FMI 3 and of FMI 2
        for platform in platforms[: 4 - self.version]:
            if (path := folder / platform / name).is_file():
                return path
        found = ", ".join(sorted(str(path.relative_to(folder)) for path in folder.glob("*/*"))) or "none"
        wanted = f"{platforms[3 - self.version]}/{name}"
        raise ValueError(f"it has no library for this computer, {wanted}, but {found}: export it for this computer")

    def begin(self, start: dict[str, Any]) -> None:
        """Make a new instance in the state of the start, unless the present one is. Raises ValueError.

        start : values of variables, by name
        """
        if self.fresh:
            return
        self.end()
        simulation = importlib.import_module("fmpy.simulation")
        self.log.clear()
        self.time = 0.0
        try:
            with quiet(), same_folder(), same_rounding():
                self.fmu = fmu = self.fmpy.instantiate_fmu(
                    self.folder,
                    self.description,
                    "CoSimulation",
                    logger=partial(note, self.log),
                    library_path=str(self.binary),
                )
                fmu.status = ERROR  # until it is in the state of the start
                self.end = weakref.finalize(self, end, fmu)
                categories = getattr(self.description, "logCategories", ())  # missing in FMPy 0.3.24 and older
                if names := [each.name for each in categories if re.search("(?i)err|fatal", each.name)]:
                    fmu.setDebugLogging(True, names)
                if self.version == 2:
                    fmu.setupExperiment(startTime=0.0)
                for settable, enter in (
                    (simulation.settable_in_instantiated, fmu.enterInitializationMode),
                    (simulation.settable_in_initialization_mode, fmu.exitInitializationMode),
                ):
                    start = simulation.apply_start_values(fmu, self.description, start, settable)
                    enter()
        except Exception as error:
            raise ValueError(f"it cannot be started: {self.reason(error)}") from None
        self.fresh, fmu.status = True, 0

    def reason(self, error: Exception) -> str:
        """Note an exception of FMPy. Returns its text, and the FMU's last message."""
        status = getattr(error, "status", None)
        if self.fmu is not None:
            self.fmu.status = status or ERROR
        text = str(error) if status is None else f"{error.function} returned {STATUS[status]}"  # type: ignore
        return ": ".join([text, *self.log])

    def transfers(self, variables: Sequence[Any]) -> list[Transfer]:
        """Return the calls that transfer the variables of ports."""
        types, kinds = importlib.import_module(f"fmpy.fmi{self.version}"), dict[str, list[tuple[int, Any]]]()
        for index, variable in enumerate(variables):
            kinds.setdefault(kind_of(variable, self.version), []).append((index, variable))
        return [
            Transfer(
                kind,
                limits(kind),
                (ctypes.c_uint * len(found))(*(variable.valueReference for _, variable in found)),
                (getattr(types, f"fmi{self.version}{kind}") * sum(math.prod(each.shape) for _, each in found))(),
                [(index, variable.shape) for index, variable in found],
            )
            for kind, found in kinds.items()
        ]

    def write(self, transfers: list[Transfer], values: Sequence[Any]) -> bool:
        """Set inputs. Returns False, and sets none, for a NaN, an infinity or a number beyond the type's range."""
        for transfer in transfers:
            numbers: list[Any] = []
            for index, shape in transfer.places:
                numbers += values[index].ravel().tolist() if shape else [values[index]]
            low, high = transfer.limits
            if not all(low <= number <= high for number in numbers):
                return False
            transfer.numbers[:] = numbers if transfer.kind in FLOATS else list(map(int, numbers))
        for transfer in transfers:
            self.exchange("Set", transfer)
        return True

    def read(self, transfers: list[Transfer], values: list[Any]) -> None:
        """Get outputs, into the list of the values of all ports."""
        for transfer in transfers:
            self.exchange("Get", transfer)
            found = iter(transfer.numbers)
            for index, shape in transfer.places:
                numbers = [next(found) for _ in range(math.prod(shape))]
                values[index] = np.array(numbers, dtype=float).reshape(shape) if shape else numbers[0]

    def exchange(self, verb: str, transfer: Transfer) -> None:
        """Set or get the numbers of a transfer. verb : Set or Get"""
        sizes = () if self.version == 2 else (len(transfer.numbers),)
        function = f"fmi{self.version}{verb}{transfer.kind}"
        component, references, numbers = self.fmu.component, transfer.references, transfer.numbers
        self.call(function, component, references, len(references), numbers, *sizes)

    def advance(self, step: float) -> None:
        """Compute a communication step. step : s. Raises RuntimeError."""
        ended = self.call("doStep", self.time, step)  # of FMI 3: event, end of the simulation, early return, time
        self.time += step
        if ended and (ended[1] or ended[2]):
            what = "simulation" if ended[1] else "step"
            raise RuntimeError(self.reason(Exception(f"the FMU ended its {what} at {ended[3]:g} s")))

    def call(self, function: str, *arguments: Any) -> Any:
        """Call a method of FMPy's FMU. Raises RuntimeError with the FMU's status and message."""
        self.fresh = False
        if self.fmu.status:  # FMI allows no further call; hold_exceptions would make one
            raise RuntimeError(": ".join(["the FMU has failed before", *self.log]))
        try:
            return getattr(self.fmu, function)(*arguments)
        except Exception as error:
            raise RuntimeError(self.reason(error)) from None


def library() -> Any:
    """Return FMPy's package. Raises ValueError if it is not installed."""
    if importlib.util.find_spec("fmpy") is None:
        raise ValueError(f"FMPy is not installed: {EXTRA}")
    with quiet():
        return importlib.import_module("fmpy")


def remove(folder: str, process: int) -> None:
    """Remove the folder of an FMU, unless this process is a fork of its owner."""
    if os.getpid() == process:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def quiet() -> Generator[None]:
    """Drop FMPy's prints, such as that of aarch64, for which it has no library that formats the messages of FMUs."""
    with redirect_stdout(io.StringIO()):
        yield


@contextmanager
def same_folder() -> Generator[None]:
    """Restore the working folder, which FMPy changes, also after an exception."""
    folder = os.getcwd()
    try:
        yield
    finally:
        os.chdir(folder)


@contextmanager
def same_rounding() -> Generator[None]:
    """Restore the floating-point environment: a library made with -ffast-math flushes the denormals of all blocks."""
    functions, environment = ctypes.CDLL("libm.so.6"), ctypes.create_string_buffer(64)
    functions.fegetenv(environment)
    try:
        yield
    finally:
        functions.fesetenv(environment)


def note(log: list[str], *message: Any) -> None:
    """Keep the last message about an error. message : ..., status, category, text"""
    if message[-3] >= ERROR:
        log[:] = [message[-1].decode(errors="replace").strip()]


def end(fmu: Any) -> None:
    """End an instance, as its state allows."""
    for allowed, function in ((fmu.status == 0, fmu.terminate), (fmu.status != FATAL, fmu.freeInstance)):
        with suppress(Exception):
            if allowed:
                function()


def kind_of(variable: Any, version: int) -> str:
    """Return the type of a variable in the names of FMI's functions. version : 2 or 3"""
    return variable.type if variable.type != "Enumeration" else "Integer" if version == 2 else "Int64"


def limits(kind: str) -> tuple[float, float]:
    """Return the lowest and highest finite number of a type."""
    if kind in FLOATS:
        return -FLOATS[kind], FLOATS[kind]
    if kind == "Boolean":
        return 0, 1
    bits = int(re.sub(r"\D", "", kind) or 32)
    return (0, 2**bits - 1) if kind.startswith("U") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
