# Generated from the source by `python -m cext.stubs`. Do not edit.
from cext.lines.i2c import I2cAdapter

class LinuxAdapter(I2cAdapter):
    combined: bool
    def __init__(self, fd: int) -> None: ...
