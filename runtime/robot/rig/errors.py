"""Error codes of rigs. docs/reference/rigs.md explains each of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from runtime.host.errors import BadInput

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path


CODES = {
    "TW101": "unreadable rig file",
    "TW102": "wrong entry in a rig file",
    "TW103": "rig of another robot",
    "TW104": "bus without an interface",
    "TW105": "interface of another kind",
    "TW106": "bus controlled by another process",
    "TW107": "bus emulated by another process",
    "TW111": "kernel without CAN support",
    "TW112": "no such interface",
    "TW113": "not a CAN interface",
    "TW114": "interface down",
    "TW115": "wrong bitrate",
    "TW116": "interface bus-off",
    "TW117": "interface without CAN FD",
    "TW118": "no permission",
    "TW119": "interface that cannot be opened",
    "TW120": "no guardian",
    "TW121": "UDP port in use",
    "TW122": "address of another machine",
    "TW123": "privileged port",
    "TW124": "serial port without permission",
    "TW125": "no such serial port",
    "TW126": "serial port in use",
    "TW127": "sensor not found",
    "TW128": "sensor does not reply",
    "TW129": "sensor rejects its set-up",
    "TW131": "no such I2C or SPI bus",
    "TW132": "I2C or SPI bus without permission",
    "TW133": "no such multiplexer",
    "TW134": "another chip at this address",
    "TW135": "address used by a kernel driver",
    "TW136": "joint without a range",
    "TW137": "battery that does not fit",
    "TW138": "limit that may not hold",
    "TW139": "key that cannot be used",
    "TW140": "record that does not apply",
}


@dataclass(frozen=True)
class RigProblem:
    """Error in a rig. code : key of CODES; message : what is wrong, and where; hint : the remedy, in one line"""

    code: str
    message: str
    hint: str = ""

    def __str__(self):
        return f"error {self.code} {CODES[self.code]}: {self.message}" + (f"\n    {self.hint}" if self.hint else "")


class RigError(BadInput):
    """A rig that cannot be used. path : path of the rig file; problems : RigProblems of the file"""

    def __init__(self, path: str | Path, problems: Iterable[RigProblem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(f"{path}: {problem}" for problem in self.problems))


class Refused(Exception):
    """A bus or device of a rig that cannot be used. problem : RigProblem"""

    def __init__(self, problem: RigProblem) -> None:
        super().__init__(str(problem))
        self.problem = problem
