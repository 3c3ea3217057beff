"""`python -m runtime bench`: the speed of this machine.

blocks      ticks of native and Python blocks, and compiles
clock       lateness of the loop
bus         a bus, and the guardian; drives: the process of emulated drives beside it
gait        errors of the gait estimators; gait_recordings: the walks
rate        the highest rate of a CAN bus: `python -m runtime rate`
measure     contenders timed in turn; report: what is printed
"""
