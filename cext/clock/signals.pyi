# Generated from the source by `python -m cext.stubs`. Do not edit.

class Signals:
    def __init__(self, handled: bool = True) -> None: ...
