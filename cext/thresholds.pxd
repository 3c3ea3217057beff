"""Every threshold of the safety functions, once. cext/thresholds.pyx has the meanings; docs/rigs.md shows the same table.

Times are in ns. Loop, watchdog, guardian and recorder read these names and have no number of their own.
"""

cpdef enum:
    # the safe stop
    STOP_ROUND = 5000000
    STOP_ROUND_MINIMUM = 100000
    STOP_DAMP_ROUND = 2000000
    STOP_LIMIT = 200000000
    # a tick that hangs
    HANG_PERIODS = 3
    HANG_MINIMUM = 15000000
    HANG_SIGNAL_PERIOD = 20000000
    HANG_SIGNAL_PERIOD_STOPPED = 100000000
    HANG_REPORT_DELAY = 300000000
    BUS_TAKEOVER_PERIOD = 1000000
    # a loop that stalls
    LOOP_STALL_PERIODS = 5
    LOOP_STALL_MINIMUM = 40000000
    # the guardian
    GUARDIAN_LOOK_PERIOD = 5000000
    GUARDIAN_SILENCE = 100000000
    GUARDIAN_LOOK_LIMIT = 50000000
    GUARDIAN_DEATH = 200000000
    GUARDIAN_KILL_LIMIT = 20000000
    BUS_LOCK_RELEASE_LIMIT = 1000000000
    # arming
    ARMING_LIMIT = 1000000000
    DISABLE_CONFIRM_LIMIT = 100000000
    FADE_IN = 500000000
    # signals
    SIGNAL_HANDLER_PERIOD = 64
    # interfaces
    TX_QUEUE_FULL_LIMIT = 10
    INTERFACE_FAILURE_LIMIT = 100
