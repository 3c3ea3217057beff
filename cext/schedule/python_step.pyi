# Generated from the source by `python -m cext.stubs`. Do not edit.
from typing import Any

KINDS: dict[Any, Any]
class Text:
    def __init__(self, template: Any, *values: Any) -> None: ...
    def __str__(self) -> Any: ...
class PythonStep:
    name: str
    hold: int
    held: int
    first_held: int
    last_held: Any
    def __init__(self, callable: Any, name: str, inputs: Any, outputs: Any, arena: Any, hold: int = 0) -> None: ...
    def __call__(self, arena: Any) -> Any: ...
