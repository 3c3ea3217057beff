"""`python -m runtime bench`: the speed of this machine.

blocks      ticks of native and Python blocks, and compiles
starting    start of the process to the first tick, and memory
clock       lateness of the loop, beside a loop in C; costs: parts of a tick
bus         a bus, the guardian, and kill -9 to the stop frames
can_cost    drives; motors and drives are processes beside it
sensors     inertial sensors on serial lines; i2c: the thread of an I2C bus
views       lateness with every recorder and viewer
rate        the highest rate of a CAN bus: `python -m runtime rate`
measure     contenders timed in turn; goals: the bounds that they are compared with; report: what is printed
"""
