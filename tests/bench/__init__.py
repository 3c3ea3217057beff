"""Performance of Tickwork itself, compared with its goals: `python -m tests.bench NAME`.

starting    start of the process to the first tick, and memory
costs       parts of a tick; recorder_cost: the recorder
can_cost    drives; motors are a process beside it
deaths      time to the stop after the death of each process of a run
sensors     inertial sensors on serial lines; i2c: the thread of an I2C bus
views       lateness with every recorder and viewer
c_program   loops in C to compare with
goals       the bounds
"""
