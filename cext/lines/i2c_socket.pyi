# Generated from the source by `python -m cext.stubs`. Do not edit.
from cext.lines.i2c import I2cAdapter

class SocketAdapter(I2cAdapter):
    def __init__(self, fd: int) -> None: ...
