# Generated from the source by `python -m cext.stubs`. Do not edit.

class EventTemplate:
    def __init__(self, event: dict) -> None: ...
