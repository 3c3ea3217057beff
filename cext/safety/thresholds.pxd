"""All thresholds of the safety functions, each below its unit and meaning.

docs/reference/safe_stop.md shows them as a table. The loop, the watchdog, the guardian and the recorder use these names
and have no values of their own.
"""

cpdef enum:
    # ns: period of the rounds of zero torque and disable in a safe stop; one period of the run if that is shorter
    STOP_ROUND = 5000000
    # ns: shortest such period
    STOP_ROUND_MINIMUM = 100000
    # ns: period of the damping frames in a safe stop; longer on a bus that is too slow for it
    STOP_DAMP_ROUND = 2000000
    # ns: duration of a safe stop, after the damping; then drives that have not confirmed are reported
    STOP_LIMIT = 200000000
    # ns: longest period of the rounds that continue after it for drives that have not confirmed; it doubles to this value
    STOP_ROUND_MAXIMUM = 200000000
    # s: time for which these rounds continue without an operator who can end them
    STOP_UNATTENDED = 10
    # s: time for which they continue after the control process has died, unless another run takes the bus
    STOP_ORPHANED = 60
    # ‰: largest torque of a drive at rest, of its rated torque, in addition to one code; measured currents of a
    #     disabled drive are not exactly zero
    STOP_REST_TORQUE = 25
    # replies: consecutive reports at rest that confirm the stop of a drive that reports by itself
    STOP_REPORTS = 2
    # ns: duration of the rest of such a drive, if its protocol has no answer to a disable
    STOP_REST = 20000000
    # ns: longest time for which a safe stop waits for the replies of one drive before it sends the next frames to it;
    #     and for which arming waits for the last answer to a disable of a drive that reports by itself
    STOP_LISTEN_LIMIT = 50000000

    # ns: age of a confirmation by the operator, from the key press, above which it has no effect
    CONSENT_LIMIT = 1000000000
    # ns: time after which the recorder must have taken a key; otherwise the terminal shows that it does not
    KEYS_UNTAKEN_LIMIT = 1000000000
    # ns: time for which the computer was suspended above which a run ends
    SUSPEND_LIMIT = 1000000
    # ns: time between two ticks after which the loop itself ends a run with a guardian, in place of a guardian that was
    #     paused with it; LOOP_STALL_PERIODS if that is longer
    PAUSE_LIMIT = 100000000
    # replies: surplus of replies over the frames to a drive that shows two drives with one id; each frame removes a
    #     quarter of a reply
    TWIN_REPLIES = 10
    # ns: time after which a reply counts as lost in that comparison
    TWIN_LATE = 500000000
    # periods: reports of a drive that reports by itself which arming compares, at least, before it is complete
    TWIN_PERIODS = 4

    # ns: age of the newest values that the page with the controls has confirmed, above which the page counts as lost
    PAGE_SILENCE = 170000000
    # ns: time for which the input of --arm-on must be active, after it was inactive
    ARM_HOLD = 1000000000

    # periods: duration of one tick after which the watchdog stops the motors
    HANG_PERIODS = 3
    # ns: duration of one tick that the watchdog always allows
    HANG_MINIMUM = 15000000
    # ns: period of the signals that interrupt a hanging Python step
    HANG_SIGNAL_PERIOD = 20000000
    # ns: period of these signals after the safe stop
    HANG_SIGNAL_PERIOD_STOPPED = 100000000
    # ns: time after the stop at which the guardian reports that a block still hangs and that only Ctrl-C ends the
    #     run
    HANG_REPORT_DELAY = 300000000
    # ns: period of the watchdog's attempts to take over the buses from a tick that hangs
    BUS_TAKEOVER_PERIOD = 1000000

    # periods: time without a tick, or for the start of the blocks, after which the guardian stops the motors
    LOOP_STALL_PERIODS = 5
    # ns: time without a tick, or for the start of the blocks, that the guardian always allows
    LOOP_STALL_MINIMUM = 40000000

    # ns: each of these, and the guardian's silence, at least in a run without actuators and relays; a block may hang
    #     for half of it
    NOTHING_TO_STOP = 1000000000

    # ns: longest period of the guardian's checks of the loop
    GUARDIAN_LOOK_PERIOD = 5000000
    # ns: time without a check by the guardian after which the loop ends the run
    GUARDIAN_SILENCE = 100000000
    # ns: the same for a guardian with SCHED_FIFO and locked memory, on interfaces that never wait
    GUARDIAN_SILENCE_REALTIME = 15000000
    # ns: time within which a running guardian has checked at least once more
    GUARDIAN_LOOK_LIMIT = 50000000
    # ns: time without a check by the guardian after which the recorder reports its death
    GUARDIAN_DEATH = 200000000
    # ns: time for a killed guardian to end before the run sends the stop frames itself
    GUARDIAN_KILL_LIMIT = 20000000
    # ns: time for the guardian of a dead run to release the buses
    BUS_LOCK_RELEASE_LIMIT = 1000000000

    # ns: time within which every device must respond during arming
    ARMING_LIMIT = 1000000000
    # ns: time within which a drive must reply to a disable before a run can be armed again
    DISABLE_CONFIRM_LIMIT = 100000000
    # ns: time in which commands rise to their full value after arming
    FADE_IN = 500000000

    # ns: time of zero torque and of rest before the zero of a drive may be set
    ZERO_REST = 100000000
    # mrad: largest movement of a joint at rest, and largest position of a drive whose zero was set
    ZERO_BAND = 10
    # ns: time after which the frame that sets a zero is repeated if the drive replies with its earlier position
    ZERO_RETRY = 100000000
    # ns: time within which a drive must confirm its zero; some are silent for a second
    ZERO_LIMIT = 2000000000

    # ticks: interval, in virtual time, at which the handlers of signals that end a run are installed again; in real
    #     time, each tick with a Python step
    SIGNAL_HANDLER_PERIOD = 64

    # ticks: consecutive ticks with a full transmit queue that end the run
    TX_QUEUE_FULL_LIMIT = 10
    # failures: consecutive failures of an interface of python-can that end the run
    INTERFACE_FAILURE_LIMIT = 100

    # °C: temperature at or below which a drive's sensor is considered broken
    TEMPERATURE_MINIMUM = -40
    # ns: longest span of replies over which a joint's acceleration is compared with max_acceleration; shorter spans
    #     are compared too
    ACCELERATION_WINDOW = 15000000
    # replies: fewest replies in that window
    ACCELERATION_WINDOW_REPLIES = 3
    # mrad/s: largest noise of a measured velocity that is allowed for in its change
    ACCELERATION_NOISE_LIMIT = 1200
    # ns: time in which stiffness and damping return after the acceleration is within max_acceleration again
    ACCELERATION_GAINS_RETURN = 100000000
    # ns: time beyond max_acceleration that ends the run; a quarter of the time within it is subtracted
    ACCELERATION_FAULT = 50000000
    # periods: shortest such time
    ACCELERATION_FAULT_PERIODS = 6
    # %: acceleration, of max_acceleration, up to which a change of the angle counts as motion
    JUMP_ACCELERATION = 400
    # rad/s²: lowest such acceleration
    JUMP_ACCELERATION_MINIMUM = 2000
    # rad/s²: max_acceleration, for such a change, of drives without that parameter
    JUMP_SUSTAINED = 500
    # ns: longest duration of such an acceleration; over longer times, max_acceleration counts
    JUMP_IMPACT = 10000000
    # ns: shortest time for which motion is allowed between two replies
    JUMP_INTERVAL = 4000000
    # ns: time for which the longest measured transit of a drive counts; up to twice that
    TRANSIT_MEMORY = 1000000000
    # periods: time without a reply to a command, beyond the transit, that may be a restart of a drive that obeys
    #     without an enable; and at least its restart_time
    RESTART_PERIODS = 2
    # mrad: distance outside the range of a joint that ends the run
    TRAVEL_MARGIN = 50
    # replies: consecutive replies beyond max_velocity that end the run
    OVERSPEED_REPLIES = 3
    # %: assumed accuracy of a drive's measured torque, of its peak torque
    TORQUE_ACCURACY = 10
    # ns: time with a torque beyond limit and accuracy that ends the run
    EXCESS_TORQUE = 20000000
    # replies: fewest replies in that time
    EXCESS_TORQUE_REPLIES = 4
    # ns: time constant of the means of the commanded and the measured torque
    FOLLOWING_MEAN = 60000000
    # %: commanded torque, of the rated torque, above which a drive must follow
    FOLLOWING_COMMANDED = 10
    # %: measured torque, of the commanded torque, below which a drive does not follow
    FOLLOWING_MEASURED = 20
    # ns: time without following that ends the run
    FOLLOWING_FAULT = 50000000
    # replies: fewest replies in that time
    FOLLOWING_FAULT_REPLIES = 4
    # %: measured torque, of the rated torque, that is a fault while no torque is commanded
    UNCOMMANDED_TORQUE_LIMIT = 5
    # ns: time with such a torque that is a fault; a quarter of the time without it is subtracted
    UNCOMMANDED_TORQUE_TIME = 60000000
    # replies: fewest replies in that time
    UNCOMMANDED_TORQUE_REPLIES = 4
    # ns: duration of motion or torque over which two measurements of one quantity are compared
    SCALE_TIME = 1000000000
    # %: permitted difference of velocity from the rate of position, and of torque from current; a difference of 10
    #     % is detected
    SCALE_TOLERANCE = 8
    # %: permitted difference of a torque in the unit of the wire from the commanded law
    SCALE_TOLERANCE_WIRE_TORQUE = 30
    # mrad/s: speed above which a joint counts as moving in that comparison
    SCALE_SPEED_MINIMUM = 500
