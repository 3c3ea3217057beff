"""Declarations of a block: ports, parameters and memory.

The reference page, the drawing, the CSV header and the error messages are generated from the declarations. Names are
unique within a block.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Sequence
from copy import copy
from types import EllipsisType
from typing import TYPE_CHECKING, Any, Generic, Literal, NamedTuple, NoReturn, TypeAlias, TypedDict, TypeVar, overload

import numpy as np

from cext.user_text import repr_of, text_of
from graph import units
from graph.diagnostics import Diagnostic, DiagramError, caller
from graph.interval import Interval
from graph.narrowing import is_row, is_table, is_tuple
from graph.signal import Signal

RAMP_TIME = 1.0  # s in which a live parameter without a slew crosses its range

TRUTHS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}  # texts of a bool
DTYPES = {float: "float", int: "int", bool: "bool", "float": "float", "int": "int", "bool": "bool"}

Shape: TypeAlias = tuple[int, ...] | EllipsisType
DType: TypeAlias = type[float] | str
Numbers: TypeAlias = float | Sequence[Any] | np.ndarray
T = TypeVar("T")
U = TypeVar("U")
D = TypeVar("D", bound="Declaration")


class Declaration:
    """A port, a parameter or a memory of a block class."""

    name = ""
    description: str

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def named(self: D, name: str) -> D:
        """Set the name and return the declaration, for ports that `configure` creates."""
        self.name = name
        return self

    if not TYPE_CHECKING:  # a type checker would take every attribute to be declared

        def __setattr__(self, name, value):
            """Set an attribute once: a declaration holds for every block of its class. Only the name may change."""
            if name in vars(self) and name != "name":
                raise AttributeError(
                    f"{name} of {self!r} cannot be assigned: all blocks of a class share its declarations. Declare it "
                    "again in a subclass"
                )
            super().__setattr__(name, value)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r})"


class Declared(dict[str, D]):
    """Declarations of a block class by name. Only a new dict, as `configure` may assign to a block, replaces them."""

    def _refuse(self, *names: object, **_: object) -> NoReturn:  # pyright: ignore[reportUnusedFunction]
        name = str(names[0]) if names else "NAME"
        raise DiagramError(
            Diagnostic(
                "TW010",
                f"{repr_of(names[0]) if names else 'they'} cannot be assigned: all blocks of a class share its "
                "declarations",
                where=caller(),
                hint=f"connect an input by calling its block, as in block({name}=...); set a parameter as in "
                f"block.{name} = ...",
            )
        )

    if not TYPE_CHECKING:
        __setitem__ = __delitem__ = pop = popitem = clear = update = setdefault = _refuse
        __ior__ = dict.__or__

    def __reduce__(self) -> tuple[Any, ...]:
        return Declared, (dict(self),)


def unit_of(unit: str, description: str, kind: str) -> str:
    """Return the canonical spelling of a unit.

    description, kind : description and kind of the port, for the message about a unit in the second place

    Raises ValueError.
    """
    try:
        return units.canonical(unit)
    except ValueError:
        try:
            units.canonical(description)
        except ValueError:
            description = ""
        if not description:
            raise
        raise ValueError(f"the unit comes first, as in {kind}({description!r}, {unit!r})") from None


class Port(Declaration):
    """An input or output port."""

    def __init__(self, unit: str, description: str = "", *, shape: Shape = (), dtype: DType = float) -> None:
        if shape is not ... and not (
            is_tuple(shape) and all(isinstance(length, int) and length > 0 for length in shape)
        ):
            raise TypeError(f"shape must be a tuple of lengths, as in (3,), or ..., got {shape!r}")
        if dtype not in DTYPES:
            raise TypeError(f"dtype must be float, int or bool, got {dtype!r}")
        self.unit = unit_of(unit, description, type(self).__name__)
        self.description = description
        self.shape = shape
        self.dtype = DTYPES[dtype]

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r}, {self.unit!r})"

    def with_unit(self: D, unit: str) -> D:
        """Return a copy with another unit, for a port that `configure` declares again. Raises ValueError."""
        port = copy(self)
        vars(port)["unit"] = unit_of(unit, self.description, type(self).__name__)
        return port


class Input(Port):
    """An input port.

    unit : canonical SI string, or "any": all "any" ports of a block share one unit
    shape : (), (3,), ...; `...` for any shape, the same for all such ports of a block
    dtype : float, int or bool
    default : value of an unwired input; without one, leaving it unwired is an error
    broadcast : with shape ..., also accept a scalar signal, combined with every element; a kernel receives size 1, a
        step a float
    """

    def __init__(
        self,
        unit: str,
        description: str = "",
        *,
        shape: Shape = (),
        dtype: DType = float,
        default: Numbers | None = None,
        broadcast: bool = False,
    ) -> None:
        super().__init__(unit, description, shape=shape, dtype=dtype)
        if broadcast and shape is not ...:
            raise TypeError(f"broadcast requires shape=..., got {shape!r}")
        try:
            np.asarray(0.0 if default is None else default, dtype=float)
        except (ValueError, TypeError, OverflowError):
            raise TypeError(f"default must be a number or an array of numbers, got {repr_of(default)}") from None
        self.default, self.broadcast = default, broadcast

    def __set__(self, block: Any, value: Any) -> None:
        """Set an attribute with the name of the input, as state of a Python block.

        Raises DiagramError for a signal, and in a native block.
        """
        if isinstance(value, Signal) or not block.is_python:
            raise DiagramError(
                Diagnostic(
                    "TW001",
                    "an assignment does not connect the input",
                    block.path,
                    self.name,
                    caller(),
                    f"call the block, as in {block.path.split('/')[-1]}({self.name}=...)",
                )
            )
        vars(block)[self.name] = value


class Output(Port):
    """An output port.

    range : (low, high) that the output never leaves, or None
    circle : (low, high) of a periodic value such as a phase or a bearing, whose two ends are equal; resampling of a
        recording interpolates across them
    kernel : the kernel of a native block writes it; False for an output that another component writes
    """

    def __init__(
        self,
        unit: str,
        description: str = "",
        *,
        shape: Shape = (),
        dtype: DType = float,
        range: tuple[float, float] | None = None,
        circle: tuple[float, float] | tuple[()] = (),
        kernel: bool = True,
    ) -> None:
        super().__init__(unit, description, shape=shape, dtype=dtype)
        if circle and not (len(circle) == 2 and -math.inf < circle[0] < circle[1] < math.inf and self.dtype == "float"):
            raise TypeError(f"circle must be (low, high) of a float output, as in (-math.pi, math.pi), got {circle!r}")
        self.kernel, self.circle = kernel, tuple(circle)
        try:
            self.range = None if range is None else Interval(*map(float, range))
        except (ValueError, TypeError, OverflowError):
            raise TypeError(f"range must be (low, high), as in (0.0, 1.0), got {repr_of(range)}") from None

    @overload
    def __get__(self, block: None, owner: type | None = None) -> Output: ...
    @overload
    def __get__(self, block: object, owner: type | None = None) -> Signal: ...
    def __get__(self, block: object | None, owner: type | None = None) -> Output | Signal:
        return self if block is None else Signal(block, self.name)


if TYPE_CHECKING:
    from typing_extensions import Unpack

    class ParamOptions(TypedDict, total=False):
        """Keyword arguments of Param besides dtype and required."""

        min: float | None
        max: float | None
        above: float | None
        below: float | None
        choices: Sequence[Any] | None
        live: bool
        fixed: bool
        slew: float | None
        file: bool
        kernel: bool


QUANTITY = re.compile(r"\s*[+-]?\.?\d\S*\s+\D")  # a number, and text after a blank


class Param(Declaration, Generic[T]):
    """A parameter, a plain attribute of the block once it is built.

    default : value if none is passed; its type is that of the parameter
    unit : unit of the value
    min, max : inclusive bounds; above, below : exclusive ones
    choices : allowed values
    live : may change while running; needs min and max, both finite
    fixed : is read before the run only, so that it cannot change while running; always True for text and tables
    slew : fastest change while running, in its unit per second; by default its live range in one second. An infinite
        slew is a step, and int and bool parameters always step
    required : has no default
    file : path of a file that the block reads; its content, not its path, enters the hash of the diagram
    kernel : the kernel of a native block reads it, if it is a number
    """

    # The type of a parameter follows from its default and dtype.
    @overload
    def __init__(
        self: Param[tuple[Any, ...]],
        default: tuple[Any, ...],
        unit: str = "1",
        description: str = "",
        *,
        required: bool = False,
        dtype: type[tuple[Any, ...]] | None = None,
        **options: Unpack[ParamOptions],
    ) -> None: ...
    @overload
    def __init__(
        self: Param[float | None],
        default: None = None,
        unit: str = "1",
        description: str = "",
        *,
        required: Literal[False] = False,
        dtype: None = None,
        **options: Unpack[ParamOptions],
    ) -> None: ...
    @overload
    def __init__(
        self: Param[U | None],
        default: None = None,
        unit: str = "1",
        description: str = "",
        *,
        required: Literal[False] = False,
        dtype: type[U],
        **options: Unpack[ParamOptions],
    ) -> None: ...
    @overload
    def __init__(
        self: Param[float],
        default: None = None,
        unit: str = "1",
        description: str = "",
        *,
        required: Literal[True],
        dtype: None = None,
        **options: Unpack[ParamOptions],
    ) -> None: ...
    @overload
    def __init__(
        self: Param[U],
        default: U | None = None,
        unit: str = "1",
        description: str = "",
        *,
        required: bool = False,
        dtype: type[U],
        **options: Unpack[ParamOptions],
    ) -> None: ...
    @overload
    def __init__(
        self: Param[U],
        default: U,
        unit: str = "1",
        description: str = "",
        *,
        required: bool = False,
        dtype: None = None,
        **options: Unpack[ParamOptions],
    ) -> None: ...
    def __init__(
        self,
        default: Any = None,
        unit: str = "1",
        description: str = "",
        *,
        min: float | None = None,
        max: float | None = None,
        above: float | None = None,
        below: float | None = None,
        choices: Sequence[Any] | None = None,
        live: bool = False,
        fixed: bool = False,
        slew: float | None = None,
        required: bool = False,
        dtype: type | None = None,
        file: bool = False,
        kernel: bool = True,
    ) -> None:
        if isinstance(default, list):
            raise TypeError(f"all blocks would share the list {default!r}: write the default as a tuple")
        self.default, self.unit, self.description = default, units.canonical(unit), description
        self.min, self.max, self.above = min, max, above
        self.below, self.choices = below, choices
        self.live, self.slew, self.required = live, slew, required
        self.file, self.kernel = file, kernel
        self.dtype = dtype or (float if default is None else type(default))
        self.fixed = fixed or not self.numeric
        if live and (min is None or max is None or not (math.isfinite(min) and math.isfinite(max))):
            raise TypeError("a live parameter needs both bounds, min and max, both finite")
        if not kernel and not self.fixed and not live:
            raise TypeError("a parameter with kernel=False must be fixed or live")
        if self.fixed and (live or slew is not None):
            raise TypeError("a fixed parameter cannot be live or have a slew")
        if slew is not None and not slew > 0.0:
            raise TypeError(f"slew must be above 0, in the parameter's unit per second, got {slew!r}")

    if TYPE_CHECKING:  # a block class replaces the declaration by an attribute of each block

        def __get__(self, block: object, owner: type | None = None) -> T: ...
        def __set__(self, block: object, value: T) -> None: ...

    @property
    def live_bounds(self) -> LiveBounds | None:
        """LiveBounds of a parameter declared live, else None."""
        if not self.live or self.min is None or self.max is None:
            return None
        return LiveBounds(self.min, self.max, self.live_slew(self.min, self.max))

    def live_slew(self, low: float, high: float) -> float:
        """Return the slew between two live bounds, in the parameter's unit per second, infinite for a step."""
        if self.dtype is not float or low == high:
            return math.inf
        return min(high - low, sys.float_info.max) / RAMP_TIME if self.slew is None else float(self.slew)

    @property
    def numeric(self) -> bool:
        """Whether it is a float, int or bool."""
        return self.dtype in (float, int, bool)

    @property
    def placed(self) -> bool:
        """Whether it has a slot in the arena."""
        return self.numeric and (self.kernel or self.live)

    def check(self, value: Any) -> Any:
        """Convert a value to the parameter's type. Raises ValueError outside its type, bounds or choices."""
        if value is None and (self.default is None and not self.required or self.dtype is object):
            return None
        if value is None:
            raise ValueError("expected a value, got None")
        if self.dtype is bool and not isinstance(value, (bool, np.bool_)):
            raise ValueError(f"expected True or False, got {repr_of(value)}")
        value = self.in_unit(value)
        if self.numeric and isinstance(value, int) and abs(value) > sys.float_info.max:
            raise ValueError("expected a number of at most 1.8e308")
        if self.numeric and is_row(value):
            raise ValueError(f"expected one number, got {repr_of(value)}")
        if self.numeric and (isinstance(value, (str, bytes)) or np.iscomplexobj(value)):
            quoted = isinstance(value, str) and value.strip("+- ").replace(".", "", 1).isdigit()
            raise ValueError(f"expected a number, got {repr_of(value)}" + ": omit the quotes" * quoted)
        if self.numeric and np.ndim(value):
            raise ValueError(f"expected one number, got {repr_of(value)}")
        if self.dtype is int and not is_whole(value):
            raise ValueError(f"expected a whole number, got {repr_of(value)}")
        if self.dtype is str and not isinstance(value, str):
            raise ValueError(f"expected text, got {repr_of(value)}")
        if self.numeric:
            try:
                value = self.dtype(value)
            except TypeError:
                raise ValueError(f"expected a number, got {repr_of(value)}") from None
            if value != value:
                raise ValueError("NaN is not allowed")
            unit = "" if self.unit in (units.ONE, units.ANY) else f" {self.unit}"
            for broken, words in (
                (self.min is not None and value < self.min, f"at least {self.min}"),
                (self.max is not None and value > self.max, f"at most {self.max}"),
                (self.above is not None and value <= self.above, f"above {self.above}"),
                (self.below is not None and value >= self.below, f"below {self.below}"),
            ):
                if broken:
                    degrees = (
                        f': if it is in degrees, write "{value:g} deg"' if self.unit == "rad" and abs(value) > 7 else ""
                    )
                    raise ValueError(f"must be {words}{unit}, got {value}{degrees}")
        if self.dtype is dict and not is_table(value):
            raise ValueError(f"expected a table in braces, got {repr_of(value)}")
        if self.choices is not None and value not in self.choices:
            raise ValueError(f"must be one of {', '.join(map(text_of, self.choices))}, got {repr_of(value)}")
        return value

    def in_unit(self, value: Any) -> Any:
        """Convert quantities that name their unit, such as "10 deg", even in a tuple. ValueError

        The text in a tuple without a unit is kept: names, or conditions such as "0.1 < time_in_state".
        """
        if is_row(value):
            return type(value)(map(self.in_unit, value)) if self.dtype is tuple and self.unit != units.ONE else value
        quantity = self.dtype in (float, tuple) and isinstance(value, str) and QUANTITY.match(value)
        return units.parse_quantity(value, self.unit) if quantity else value

    def parse(self, text: str) -> Any:
        """Parse command-line text, such as '40', '60 deg' or 'true'. Raises ValueError if it is not valid."""
        if self.dtype is bool:
            if text.lower() not in TRUTHS:
                raise ValueError(f"expected true or false, got {text!r}")
            return TRUTHS[text.lower()]
        if self.dtype is object:
            try:
                return self.check(float(text))
            except ValueError:
                return self.check(text)
        if self.dtype is tuple:
            raise ValueError("cannot be set as text: in a file, write a list without quotes, as in [0.0, 1.0]")
        if not self.numeric:
            return self.check(text)
        hexadecimal = self.dtype is int and text[:2].lower() == "0x"
        return self.check(int(text, 16) if hexadecimal else units.parse_quantity(text, self.unit))


def is_whole(value: Any) -> bool:
    """Return whether a number is finite and whole; False for a bool."""
    try:
        return not isinstance(value, bool) and math.isfinite(value) and value == int(value)
    except TypeError:
        return False


class LiveBounds(NamedTuple):
    """Bounds of a parameter while running. slew : fastest change, in its unit per second"""

    min: float
    max: float
    slew: float = math.inf


class Live:
    """A parameter's value that may change while running, within bounds: `limit=Live(12.0, max=15.0, slew=2.0)`.

    min, max, slew : by default those of the parameter. Both bounds are required, and the range proof covers all values
    between them. Without a slew the value crosses its range in one second; `slew=math.inf` is a step. int and bool
    parameters always step.
    """

    def __init__(
        self, value: float, *, min: float | None = None, max: float | None = None, slew: float | None = None
    ) -> None:
        self.value, self.min, self.max = value, min, max
        self.slew: Any = slew

    def bounds(self, param: Param[Any]) -> LiveBounds:
        """Return the LiveBounds for a Param. Raises ValueError for invalid bounds."""
        if param.fixed:
            raise ValueError(
                "cannot be Live: it is read before the run only. Pass a plain value, and change it for the next run "
                "with --set"
            )
        low = param.min if self.min is None else param.check(self.min)
        high = param.max if self.max is None else param.check(self.max)
        if low is None or high is None:
            raise ValueError("a live parameter needs both bounds: write Live(value, min=..., max=...)")
        if not (math.isfinite(low) and math.isfinite(high) and low <= high):
            raise ValueError(f"live bounds must be finite and in order, got {low:g} to {high:g}")
        if self.slew is None or param.dtype is not float:
            return LiveBounds(low, high, param.live_slew(low, high))
        if not (isinstance(self.slew, (int, float)) and self.slew > 0.0):
            raise ValueError(f"a live parameter's slew must be above 0, in its unit per second, got {self.slew!r}")
        return LiveBounds(low, high, float(self.slew))


class Memory(Declaration):
    """State or coefficients of a native block, in the arena.

    initial : value at reset, unless `prepare` sets another, of any length
    """

    def __init__(self, initial: Numbers = 0.0, description: str = "") -> None:
        self.initial, self.description = initial, description

    if TYPE_CHECKING:  # an attribute of the block replaces the declaration

        def __get__(self, block: object, owner: type | None = None) -> Any: ...
        def __set__(self, block: object, value: Numbers) -> None: ...
