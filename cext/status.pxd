"""Statuses of a run that no kernel returns, besides those of cext/abi.pxd, which every kernel includes."""

cdef enum:
    PYTHON_ERROR = 3        # a Python block raised
    NO_ANSWER = 4           # a device did not reply during arming
    SILENT = 5              # a device did not reply for longer than its timeout
    DEVICE_FAULT = 6        # a device reports a fault
    BUS_ERROR = 7           # a bus cannot receive or send
    FENCED = 8              # another process has stopped the run
    OVERRUN = 9             # more grid points were missed than the run allows
    UNGUARDED = 10          # the guardian does not respond
    FOREIGN_COMMAND = 11    # another node commands one of the run's devices
    HUNG = 12               # a step did not return, and the watchdog has stopped the devices
    RMS_TORQUE = 14         # a drive's RMS torque exceeds the rated torque, and its mode ends the run
    TOO_HOT = 15            # a drive's temperature exceeds its limit
    BEYOND_ACCELERATION = 16    # a joint keeps accelerating above the bound that its limit depends on
    BEYOND_TORQUE = 17      # a drive's measured torque exceeds its limit plus its accuracy
    OVER_TRAVEL = 18        # a joint is outside its range
    OVERSPEED = 19          # a joint exceeds its max_velocity
    NOT_FOLLOWING = 20      # a drive does not produce the commanded torque
    # two measurements of one quantity differ: an encoded range or a constant does not match the drive
    SCALE_MISMATCH = 21
    IMPLAUSIBLE = 22        # an impossible measurement
    UNCLEAR_POSE = 23       # a joint may be at another position than its drive reports
    UNCOMMANDED_TORQUE = 30 # a drive produces torque that is not commanded
    PROGRAM_SILENT = 40     # the loop of a connected program takes too long
    SUSPENDED = 24          # the computer was suspended in the middle of the run
    POSITION_JUMP = 25      # a reported angle has changed by more than motion can explain
    TWO_DEVICES = 41        # two devices answer to one id
    PAGE_LOST = 42          # the page of the panel that has the controls is lost, which the diagram makes a stop
