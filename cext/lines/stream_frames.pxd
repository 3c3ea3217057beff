"""What the frames of a stream are: every line that is no CAN bus, a tty, a socket, an input of the computer."""

cdef enum: # id of a frame
    BYTES = 0                       # its data
    LOST = 1                        # the line is gone: unplugged, hung up
    BACK = 2                        # and there again
    LEVEL = 3                       # of an input of the computer as a run begins: 1 or 0
