# cython: freethreading_compatible=True
"""Outcome of a run, and the names of the faults."""

from dataclasses import dataclass

from cext.abi cimport ESTOP, NOT_FINITE, OK, OUT_OF_LIMITS
from cext.status cimport (
    BEYOND_ACCELERATION, BEYOND_TORQUE, BUS_ERROR, DEVICE_FAULT, FENCED, FOREIGN_COMMAND, HUNG, IMPLAUSIBLE,
    NOT_FOLLOWING, NO_ANSWER, OVERRUN, OVERSPEED, OVER_TRAVEL, PAGE_LOST, POSITION_JUMP, PROGRAM_SILENT,
    PYTHON_ERROR, RMS_TORQUE, SCALE_MISMATCH, SILENT, SUSPENDED, TOO_HOT, TWO_DEVICES, UNCLEAR_POSE,
    UNCOMMANDED_TORQUE, UNGUARDED,
)

STATUS = {
    OK: "ok",
    NOT_FINITE: "not finite",
    OUT_OF_LIMITS: "out of limits",
    PYTHON_ERROR: "exception",
    NO_ANSWER: "no answer",
    SILENT: "silent",
    DEVICE_FAULT: "device fault",
    BUS_ERROR: "bus error",
    FENCED: "fenced",
    OVERRUN: "overrun",
    UNGUARDED: "unguarded",
    FOREIGN_COMMAND: "foreign command",
    HUNG: "hung",
    RMS_TORQUE: "rms torque",
    TOO_HOT: "too hot",
    ESTOP: "e-stop",
    BEYOND_ACCELERATION: "acceleration",
    BEYOND_TORQUE: "excess torque",
    OVER_TRAVEL: "over-travel",
    OVERSPEED: "overspeed",
    NOT_FOLLOWING: "not following",
    SCALE_MISMATCH: "scale mismatch",
    IMPLAUSIBLE: "implausible",
    UNCLEAR_POSE: "unclear pose",
    UNCOMMANDED_TORQUE: "uncommanded torque",
    TWO_DEVICES: "two devices",
    POSITION_JUMP: "position jump",
    PROGRAM_SILENT: "program silent",
    PAGE_LOST: "page lost",
    SUSPENDED: "suspended",
}

# After these a run may be armed again. Not after a stop by another process, without an operator, or for a wrong scale,
# which would persist.
SURVIVED = frozenset((
    NOT_FINITE, OUT_OF_LIMITS, PYTHON_ERROR, NO_ANSWER, SILENT, DEVICE_FAULT, OVERRUN, ESTOP, RMS_TORQUE, TOO_HOT,
    BEYOND_ACCELERATION, BEYOND_TORQUE, OVER_TRAVEL, OVERSPEED, NOT_FOLLOWING, IMPLAUSIBLE, UNCOMMANDED_TORQUE,
    PAGE_LOST,
))


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run.

    status : "ok", or the fault: one of the values of STATUS, or "kernel status N"
    culprit : path of the block, device or bus that failed, or None
    tick : grid point of the fault; -1 while arming
    signal : number of the signal that ended the run, 0 for none
    error : exception of a Python block, or None; for a hung one, the KeyboardInterrupt of the watchdog
    unconfirmed : paths of the devices that did not confirm the safe stop
    late : (path, s) of the devices that confirmed it only after STOP_LIMIT, and when
    unanswered : paths of the devices that did not reply while arming
    stopped : origin of the request that ended the run: "keys", "page" and the number of a page of the panel, or "set"
        and the ID of its process; "" without one
    hung : s that the tick of a hung block ran until it returned; else 0
    faults : Outcome of each fault that the run has survived by arming again
    """

    status: str
    culprit: str | None
    tick: int
    signal: int
    error: BaseException | None
    unconfirmed: tuple
    unanswered: tuple
    stopped: str = ""
    hung: float = 0.0
    faults: tuple = ()
    late: tuple = ()

    @property
    def faulted(self) -> bool:
        """Whether the run ended in a fault."""
        return self.status != "ok"


def name_of(int status) -> str:
    """Return the name of a tick's status."""
    return STATUS.get(status, "kernel status %d" % status)
