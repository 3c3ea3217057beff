"""`python -m runtime emulate FILE --rig RIG`: the plant of a robot on the real buses of its rig, for a robot in another
process.

buses       what is opened, and how it is kept from a second emulator
carrier     the process that carries frames where python-can drives the interface
serving     the plant's clock, and its status line
command     the command line, and what it prints
"""
