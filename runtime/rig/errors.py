"""What can be wrong with a rig, each kind with a code of its own. docs/rigs.md tells of every one."""

from dataclasses import dataclass

from runtime.base.errors import BadInput

CODES = {
    "TW101": "rig file that cannot be read",
    "TW102": "wrong entry in a rig file",
    "TW103": "rig of another robot",
    "TW104": "bus without an interface",
    "TW105": "interface of another kind",
    "TW106": "bus that somebody else controls",
    "TW107": "bus that somebody else emulates",
    "TW111": "kernel without CAN",
    "TW112": "no such interface",
    "TW113": "interface that is not CAN",
    "TW114": "interface is down",
    "TW115": "wrong bitrate",
    "TW116": "interface is bus-off",
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
    "TW127": "sensor that is not found",
    "TW128": "sensor that does not answer",
    "TW129": "sensor that refuses its set-up",
    "TW131": "no such I2C bus",
    "TW132": "I2C bus without permission",
    "TW133": "no multiplexer there",
    "TW134": "another chip at this address",
    "TW135": "address of a driver of the kernel",
    "TW136": "joint without a range",
}


@dataclass(frozen=True)
class Trouble:
    """code : key of CODES; message : what is wrong, and where in the rig; hint : the cure, in one line"""

    code: str
    message: str
    hint: str = ""

    def __str__(self):
        return f"error {self.code} {CODES[self.code]}: {self.message}" + (f"\n    {self.hint}" if self.hint else "")


class RigError(BadInput):
    """A rig that cannot be used: everything that is wrong with it, in `troubles`."""

    def __init__(self, path, troubles):
        self.troubles = tuple(troubles)
        super().__init__("\n".join(f"{path}: {trouble}" for trouble in self.troubles))


class Refused(Exception):
    """One bus of a rig that cannot be. trouble : why, and the cure"""

    def __init__(self, trouble):
        super().__init__(str(trouble))
        self.trouble = trouble
