"""All thresholds of the safety functions, each below its unit and meaning. docs/rigs.md shows them as a table.

The loop, the watchdog, the guardian and the recorder use these names and have no values of their own.
"""

cpdef enum:
    # ns: between rounds of zero torque and disable in a safe stop; one period of the run where that is shorter
    STOP_ROUND = 5000000
    # ns: the same, at the fastest rates
    STOP_ROUND_MINIMUM = 100000
    # ns: between frames of damping in a safe stop; longer where a slow bus cannot carry them
    STOP_DAMP_ROUND = 2000000
    # ns: of a safe stop, after the damping; then the drives that have not confirmed are reported
    STOP_LIMIT = 200000000

    # periods: that one tick may work before the watchdog stops the motors
    HANG_PERIODS = 3
    # ns: that one tick may always work
    HANG_MINIMUM = 15000000
    # ns: between signals that break off a Python step that hangs
    HANG_SIGNAL_PERIOD = 20000000
    # ns: the same, once the safe stop is over
    HANG_SIGNAL_PERIOD_STOPPED = 100000000
    # ns: after the stop of a block that hangs; if it still hangs, the guardian reports that only Ctrl-C ends the run
    HANG_REPORT_DELAY = 300000000
    # ns: between the watchdog's attempts to take the buses from a tick that hangs
    BUS_TAKEOVER_PERIOD = 1000000

    # periods: without a tick before the guardian stops the motors; also for blocks to start after arming
    LOOP_STALL_PERIODS = 5
    # ns: without a tick that the guardian always allows; also for blocks to start
    LOOP_STALL_MINIMUM = 40000000

    # ns: between the guardian's looks at the loop, at most
    GUARDIAN_LOOK_PERIOD = 5000000
    # ns: without a look of the guardian before the loop ends the run
    GUARDIAN_SILENCE = 100000000
    # ns: in which a guardian that runs has looked at least once more
    GUARDIAN_LOOK_LIMIT = 50000000
    # ns: without a look of the guardian before the recorder reports that it is dead
    GUARDIAN_DEATH = 200000000
    # ns: for a guardian that the run has killed to be gone, before the run sends in its place
    GUARDIAN_KILL_LIMIT = 20000000
    # ns: for the guardian of a dead run to release its buses
    BUS_LOCK_RELEASE_LIMIT = 1000000000

    # ns: in which every device must have answered
    ARMING_LIMIT = 1000000000
    # ns: in which a drive must have answered its disable before a run may be armed again
    DISABLE_CONFIRM_LIMIT = 100000000
    # ns: over which commands grow to their full size after arming
    FADE_IN = 500000000

    # ticks: in virtual time between installations of the handlers of signals that end a run; in real time each tick
    #     with a Python step
    SIGNAL_HANDLER_PERIOD = 64

    # ticks: in a row with a full transmit queue, which end the run
    TX_QUEUE_FULL_LIMIT = 10
    # failures: in a row of an interface of python-can, which end the run
    INTERFACE_FAILURE_LIMIT = 100

    # °C: at or below which a drive's temperature is not one: its sensor is broken
    TEMPERATURE_MINIMUM = -40
    # ns: over which a joint's acceleration is held against its max_acceleration, and over every shorter span of
    #     replies
    ACCELERATION_WINDOW = 15000000
    # replies: that this window has at least
    ACCELERATION_WINDOW_REPLIES = 3
    # mrad/s: of a velocity's noise, as it is measured, that are allowed for in its change
    ACCELERATION_NOISE_LIMIT = 1200
    # ns: over which stiffness and damping return, once no span is beyond max_acceleration
    ACCELERATION_GAINS_RETURN = 100000000
    # ns: beyond max_acceleration that end the run; calm takes a quarter of its length away
    ACCELERATION_FAULT = 50000000
    # periods: the same, at the least
    ACCELERATION_FAULT_PERIODS = 6
    # mrad: outside the range of a joint that end the run
    TRAVEL_MARGIN = 50
    # replies: in a row beyond max_velocity that end the run
    OVERSPEED_REPLIES = 3
    # %: of the peak torque, to which a drive's measured torque is trusted: an assumption
    TORQUE_ACCURACY = 10
    # ns: of torque beyond limit and accuracy that end the run
    EXCESS_TORQUE = 20000000
    # replies: the same, at the least
    EXCESS_TORQUE_REPLIES = 4
    # ns: time constant of the means of the torque commanded and measured
    FOLLOWING_MEAN = 60000000
    # %: of the rated torque, above which a drive must follow what is commanded
    FOLLOWING_COMMANDED = 10
    # %: of the torque commanded, below which a drive does not follow
    FOLLOWING_MEASURED = 20
    # ns: without following that end the run
    FOLLOWING_FAULT = 50000000
    # replies: the same, at the least
    FOLLOWING_FAULT_REPLIES = 4
    # ns: of motion, or of torque, over which two measurements of one thing are compared
    SCALE_TIME = 1000000000
    # %: by which velocity and position may differ, and torque and current: what is 10 % off is found
    SCALE_TOLERANCE = 8
    # %: by which a torque in the wire's own unit may differ from the law that was sent
    SCALE_TOLERANCE_WIRE_TORQUE = 30
    # mrad/s: above which a joint moves, for that comparison
    SCALE_SPEED_MINIMUM = 500
