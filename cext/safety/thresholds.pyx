# cython: freethreading_compatible=True
"""Safety thresholds for Python and the documentation: `table()`.

To add one: a line in the .pxd, a line in MEANINGS, and the row in docs/rigs.md that this module's test prints.
"""

from collections import namedtuple

Threshold = namedtuple("Threshold", "name value unit meaning")

MEANINGS = {
    "STOP_ROUND": ("ns", "between rounds of zero torque and disable in a safe stop; one period of the run where that is shorter"),
    "STOP_ROUND_MINIMUM": ("ns", "the same, at the fastest rates"),
    "STOP_DAMP_ROUND": ("ns", "between frames of damping in a safe stop; longer where a slow bus cannot carry them"),
    "STOP_LIMIT": ("ns", "of a safe stop, after the damping; then the drives that have not confirmed are reported"),
    "HANG_PERIODS": ("periods", "that one tick may work before the watchdog stops the motors"),
    "HANG_MINIMUM": ("ns", "that one tick may always work"),
    "HANG_SIGNAL_PERIOD": ("ns", "between signals that break off a Python step that hangs"),
    "HANG_SIGNAL_PERIOD_STOPPED": ("ns", "the same, once the safe stop is over"),
    "HANG_REPORT_DELAY": ("ns", "after the stop of a block that hangs; if it still hangs, the guardian reports that only Ctrl-C ends the run"),
    "BUS_TAKEOVER_PERIOD": ("ns", "between the watchdog's attempts to take the buses from a tick that hangs"),
    "LOOP_STALL_PERIODS": ("periods", "without a tick before the guardian stops the motors; also for blocks to start after arming"),
    "LOOP_STALL_MINIMUM": ("ns", "without a tick that the guardian always allows; also for blocks to start"),
    "GUARDIAN_LOOK_PERIOD": ("ns", "between the guardian's looks at the loop, at most"),
    "GUARDIAN_SILENCE": ("ns", "without a look of the guardian before the loop ends the run"),
    "GUARDIAN_LOOK_LIMIT": ("ns", "in which a guardian that runs has looked at least once more"),
    "GUARDIAN_DEATH": ("ns", "without a look of the guardian before the recorder reports that it is dead"),
    "GUARDIAN_KILL_LIMIT": ("ns", "for a guardian that the run has killed to be gone, before the run sends in its place"),
    "BUS_LOCK_RELEASE_LIMIT": ("ns", "for the guardian of a dead run to release its buses"),
    "ARMING_LIMIT": ("ns", "in which every device must have answered"),
    "DISABLE_CONFIRM_LIMIT": ("ns", "in which a drive must have answered its disable before a run may be armed again"),
    "FADE_IN": ("ns", "over which commands grow to their full size after arming"),
    "SIGNAL_HANDLER_PERIOD": ("ticks", "in virtual time between installations of the handlers of signals that end a run; in real time each tick with a Python step"),
    "TX_QUEUE_FULL_LIMIT": ("ticks", "in a row with a full transmit queue, which end the run"),
    "INTERFACE_FAILURE_LIMIT": ("failures", "in a row of an interface of python-can, which end the run"),
    "TEMPERATURE_MINIMUM": ("°C", "at or below which a drive's temperature is not one: its sensor is broken"),
    "ACCELERATION_WINDOW": ("ns", "over which a joint's acceleration is held against its max_acceleration, and over every shorter span of replies"),
    "ACCELERATION_WINDOW_REPLIES": ("replies", "that this window has at least"),
    "ACCELERATION_NOISE_LIMIT": ("mrad/s", "of a velocity's noise, as it is measured, that are allowed for in its change"),
    "ACCELERATION_GAINS_RETURN": ("ns", "over which stiffness and damping return, once no span is beyond max_acceleration"),
    "ACCELERATION_FAULT": ("ns", "beyond max_acceleration that end the run; calm takes a quarter of its length away"),
    "ACCELERATION_FAULT_PERIODS": ("periods", "the same, at the least"),
    "TRAVEL_MARGIN": ("mrad", "outside the range of a joint that end the run"),
    "OVERSPEED_REPLIES": ("replies", "in a row beyond max_velocity that end the run"),
    "TORQUE_ACCURACY": ("%", "of the peak torque, to which a drive's measured torque is trusted: an assumption"),
    "EXCESS_TORQUE": ("ns", "of torque beyond limit and accuracy that end the run"),
    "EXCESS_TORQUE_REPLIES": ("replies", "the same, at the least"),
    "FOLLOWING_MEAN": ("ns", "time constant of the means of the torque commanded and measured"),
    "FOLLOWING_COMMANDED": ("%", "of the rated torque, above which a drive must follow what is commanded"),
    "FOLLOWING_MEASURED": ("%", "of the torque commanded, below which a drive does not follow"),
    "FOLLOWING_FAULT": ("ns", "without following that end the run"),
    "FOLLOWING_FAULT_REPLIES": ("replies", "the same, at the least"),
    "SCALE_TIME": ("ns", "of motion, or of torque, over which two measurements of one thing are compared"),
    "SCALE_TOLERANCE": ("%", "by which velocity and position may differ, and torque and current: what is 10 % off is found"),
    "SCALE_TOLERANCE_WIRE_TORQUE": ("%", "by which a torque in the wire's own unit may differ from the law that was sent"),
    "SCALE_SPEED_MINIMUM": ("mrad/s", "above which a joint moves, for that comparison"),
}


def table():
    """Return one Threshold for each name of cext/safety/thresholds.pxd.

    Their values become attributes of this module on import.
    """
    return tuple(Threshold(name, globals()[name], *about) for name, about in MEANINGS.items())
