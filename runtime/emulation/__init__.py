"""Emulation of a robot's plant on the real buses of its rig: `python -m runtime emulate FILE --rig RIG`.

buses       interfaces, and the lock against a second emulator
carrier     process that carries frames of python-can's interfaces
serving     clock of the plant, and status line
command     command line and its output
"""
