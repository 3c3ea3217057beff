"""Emulation of a robot's plant on the real buses of its rig: `python -m runtime emulate FILE --rig RIG`.

buses             interfaces, and the lock against a second emulator
carrier           process that carries frames of python-can's interfaces
i2c_server        chips of an I2C bus, on a socket
spi_server        the same for SPI
gpio_server       GPIO line, on a socket
socket_server     thread that both share
network_senders   datagrams and TCP servers
lines             terminals, senders and servers of all lines
priority          real-time priority of the threads
serving           clock of the plant, and status line
"""
