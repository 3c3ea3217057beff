# Generated from the source by `python -m cext.stubs`. Do not edit.

class Reopening:
    def __init__(self) -> None: ...
