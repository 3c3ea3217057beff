"""Frames of a stream, which is any line other than a CAN bus: a tty, a socket, a GPIO line, an input device."""

cdef enum: # id of a frame
    BYTES = 0                       # its data
    LOST = 1                        # the line was disconnected
    BACK = 2                        # the line was connected again
    LEVEL = 3                       # level of a GPIO line at the start of a run: 1 or 0
