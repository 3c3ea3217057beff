"""The device families that are installed: every `family` module of this library, and those that entry points name."""

import importlib
import importlib.metadata
import pkgutil
import re
import warnings
from functools import cache
from typing import Any

import blocks
from graph.family import ENTRY_POINTS, Benchmark, Drive, Family
from graph.names import suggestion

OBJECT = "FAMILY"  # of a `family` module of this library


@cache
def families() -> tuple[Family, ...]:
    """Return every Family, in the order in which commands query them. One that cannot be loaded causes a warning."""
    modules = [info.name for info in pkgutil.walk_packages(blocks.__path__, f"{blocks.__name__}.")]
    own = [name for name in modules if name.endswith(".family")]
    loads = [(name, lambda name=name: getattr(importlib.import_module(name), OBJECT)) for name in own]
    loads += [(point.value, point.load) for point in importlib.metadata.entry_points(group=ENTRY_POINTS)]
    loaded: list[Family] = []
    for name, load in loads:
        try:
            family = load()
            if not isinstance(family, Family):
                raise TypeError(f"expected an instance of graph.family.Family, got {family!r}")
        except Exception as error:  # an exception in one plug-in must not affect the others
            warnings.warn(f"device family {name} cannot be loaded: {type(error).__name__}: {error}", stacklevel=2)
        else:
            loaded.append(family)
    return tuple(sorted(loaded, key=lambda family: -family.precedence))


def family_of(block: Any) -> Family | None:
    """Return the Family that has the class of an actuator block, None without one."""
    return next((family for family in families() if drive_of(block, family)), None)


def drive_of(block: Any, family: Family) -> Drive | None:
    """Return the Drive of a family that has the class of a block, or None."""
    return next((drive for drive in family.drives if isinstance(block, drive.block)), None)


def example_models() -> list[str]:
    """Return the names of two models, for help texts, of two families if possible."""
    models = [next(iter(table.models), "MODEL") for family in families() for table in family.tables[:1]]
    return (models[::-1] * 2)[:2]


def benchmark(medium: str) -> Benchmark:
    """Return the graph.family.Benchmark of the first family with one on a medium: can, stream or i2c."""
    devices = [family.benchmark for family in families() if family.benchmark is not None]
    return next(device for device in devices if device.block.medium == medium)


def find_model(name: str, option: str = "") -> tuple[Drive, Any]:
    """Return (Drive, model) of a model's name. Raises ValueError, with the cause or a suggestion.

    option : option of the Drive; if empty, the name may end in an option, as in "MODEL-servo"
    """
    drives = [drive for family in families() for drive in family.drives]
    options = {word for drive in drives for word in (drive.option, *drive.endings) if word}
    ending = re.fullmatch(rf"(.+?)[\W_]*({'|'.join(sorted(options))})(?:[\W_]*mode)?[\W_]*", str(name), re.IGNORECASE)
    if ending and not option:
        return find_model(ending[1], ending[2].lower())
    causes: dict[Family, str] = {}
    for family in families():
        for drive in family.drives:
            if option in (drive.option, *drive.endings):
                try:
                    return drive, drive.find(name)
                except ValueError as error:
                    causes[family] = str(error)
    for family, cause in causes.items():
        if len(causes) == 1 or family.recognises(name):
            raise ValueError(cause)
    close = suggestion(str(name), [model for family in causes for table in family.tables for model in table.models])
    raise ValueError(
        f"no device family that is installed has a model {name!r}; {close or 'blocks --actuators lists them'}"
    )
