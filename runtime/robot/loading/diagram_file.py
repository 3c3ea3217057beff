"""Loaded diagram file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from graph import Diagram


@dataclass
class DiagramFile:
    """Loaded diagram file: its module, and the parameters of its `build` and `plant`.

    path : path of the file, or the name of a Diagram without one
    module : namespace with `diagram`, `build` or `plant`
    build_parameters, plant_parameters : {name: value} from the settings
    sha256 : hex digest of the source that was run; None without a file
    given : Diagram that the caller has passed instead of a file
    """

    path: Path
    module: ModuleType | SimpleNamespace
    build_parameters: dict[str, Any]
    plant_parameters: dict[str, Any]
    sha256: str | None = None
    given: Diagram | None = None

    @property
    def has_plant(self) -> bool:
        """Whether the file has a function `plant`."""
        return self.function("plant") is not None

    def function(self, name: str) -> Callable[..., Any] | None:
        """Return a function of the file, or None."""
        function = getattr(self.module, name, None)
        return function if callable(function) else None
