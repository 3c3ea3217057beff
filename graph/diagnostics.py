"""Diagnostics of diagrams: data first, text last."""

import sys
from collections.abc import Iterable
from pathlib import Path
from types import FrameType, TracebackType

from msgspec import Struct

CODES = {
    "TW001": "unconnected input",
    "TW002": "unit mismatch",
    "TW003": "shape mismatch",
    "TW004": "input wired twice",
    "TW005": "actuator never commanded",
    "TW006": "algebraic loop",
    "TW007": "command not provably inside its limit",
    "TW008": "dtype mismatch",
    "TW009": "name used twice",
    "TW010": "wrong parameter",
    "TW011": "outside a diagram",
    "TW012": "no such port",
    "TW013": "duplicate device address",
    "TW014": "incompatible rates",
    "TW015": "block without a step",
    "TW016": "bus overload",
    "TW017": "step cannot be compiled",
    "TW018": "block that must run in every tick",
    "TW019": "subsystem not entered",
    "TW020": "unused outputs",
    "TW021": "command may be held",
    "TW022": "high bus load",
    "TW023": "not compiled",
    "TW024": "actuator without temperature monitoring",
    "TW025": "different bitrates on one bus",
    "TW026": "setpoint out of reach",
    "TW027": "command without effect",
    "TW028": "setting that differs from its table",
    "TW029": "torque not limited by the command",
    "TW030": "format of a newer version",
    "TW031": "missing library",
    "TW032": "block from a local file",
    "TW033": "periodic value at a smooth input",
    "TW034": "limit after an integral",
    "TW035": "limit on an assumed number",
    "TW036": "cap that cannot hold",
    "TW037": "unstable system",
    "TW038": "continuous states in a robot",
    "TW039": "step longer than a time constant",
}


class Location(Struct, frozen=True):
    """The file and line of a block or a wire."""

    file: str
    line: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


class Diagnostic(Struct, frozen=True):
    """An error or a warning about a diagram.

    code : key of CODES
    message : the problem, with the expected and the actual value
    path : path of the block, such as "left/knee"
    port : name of the port, or ""
    where : Location in the user's files, or None
    hint : the remedy
    severity : "error" or "warning"
    """

    code: str
    message: str
    path: str = ""
    port: str = ""
    where: Location | None = None
    hint: str = ""
    severity: str = "error"

    @property
    def title(self) -> str:
        """Title of the code."""
        return CODES[self.code]

    def __str__(self) -> str:
        subject = f"{self.path}.{self.port}" if self.port else self.path
        place = f"{self.where}: " if self.where else ""
        line = f"{place}{self.severity} {self.code} {self.title}: "
        line += f"{subject}: {self.message}" if subject else self.message
        return f"{line}\n    {self.hint}" if self.hint else line


class DiagramError(Exception):
    """An invalid diagram, block or wire. `diagnostics` lists every problem."""

    def __init__(self, diagnostics: Diagnostic | Iterable[Diagnostic]) -> None:
        self.diagnostics = [diagnostics] if isinstance(diagnostics, Diagnostic) else list(diagnostics)
        super().__init__("\n".join(str(diagnostic) for diagnostic in self.diagnostics))
        if sys.excepthook is sys.__excepthook__:
            sys.excepthook = _show

    def _render_traceback_(self) -> list[str]:
        """Return the lines that IPython shows instead of a traceback: each diagnostic names the user's line."""
        return str(self).splitlines()


def _show(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print a DiagramError that ends a program without its traceback, as IPython does; any other as Python does."""
    if isinstance(error, DiagramError) and all(diagnostic.where for diagnostic in error.diagnostics):
        print(error, file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


_OWN = tuple(str(Path(__file__).resolve().parent.parent / package) + "/" for package in ("graph", "blocks"))


def caller() -> Location | None:
    """Return the Location of the nearest frame outside `graph` and `blocks`: the user's line."""
    frame: FrameType | None = sys._getframe(1)  # pyright: ignore[reportPrivateUsage] as in CPython's own modules
    while frame is not None and frame.f_code.co_filename.startswith(_OWN):
        frame = frame.f_back
    return Location(frame.f_code.co_filename, frame.f_lineno) if frame is not None else None
