"""Units of ports and parameters: canonical SI strings, strict comparison, explicit conversion.

    canonical("N*m/rad")            'N·m/rad'
    convert(60.0, "deg", "rad")     1.047...
    multiply("N·m/rad", "rad")      'N·m'

A unit is a product of symbols with whole exponents. "any" is the only wildcard; "1" is a plain number.
"""

import difflib
import math
import re
from collections.abc import Iterable
from functools import cache

from graph.narrowing import is_row

ANY, ONE = "any", "1"

# symbol: (factor to the base unit, exponents of the base unit). The order is the order in which symbols are written.
_BASE: dict[str, tuple[float, dict[str, int]]] = {
    "N": (1.0, {"kg": 1, "m": 1, "s": -2}),
    "J": (1.0, {"kg": 1, "m": 2, "s": -2}),
    "W": (1.0, {"kg": 1, "m": 2, "s": -3}),
    "kg": (1.0, {"kg": 1}),
    "g": (1e-3, {"kg": 1}),
    "km": (1e3, {"m": 1}),
    "m": (1.0, {"m": 1}),
    "cm": (1e-2, {"m": 1}),
    "mm": (1e-3, {"m": 1}),
    "V": (1.0, {"kg": 1, "m": 2, "s": -3, "A": -1}),
    "mV": (1e-3, {"kg": 1, "m": 2, "s": -3, "A": -1}),
    "µV": (1e-6, {"kg": 1, "m": 2, "s": -3, "A": -1}),
    "A": (1.0, {"A": 1}),
    "mA": (1e-3, {"A": 1}),
    "Ω": (1.0, {"kg": 1, "m": 2, "s": -3, "A": -2}),
    "T": (1.0, {"kg": 1, "s": -2, "A": -1}),
    "µT": (1e-6, {"kg": 1, "s": -2, "A": -1}),
    "G": (1e-4, {"kg": 1, "s": -2, "A": -1}),
    "Pa": (1.0, {"kg": 1, "m": -1, "s": -2}),
    "Hz": (1.0, {"s": -1}),
    "h": (3600.0, {"s": 1}),
    "min": (60.0, {"s": 1}),
    "s": (1.0, {"s": 1}),
    "ms": (1e-3, {"s": 1}),
    "µs": (1e-6, {"s": 1}),
    "rad": (1.0, {"rad": 1}),
    "deg": (math.pi / 180.0, {"rad": 1}),
    "rev": (2.0 * math.pi, {"rad": 1}),
    "rpm": (2.0 * math.pi / 60.0, {"rad": 1, "s": -1}),
    "K": (1.0, {"K": 1}),
    "°C": (1.0, {"K": 1}),
    "%": (1e-2, {}),
}
_ORDER = {symbol: index for index, symbol in enumerate(_BASE)}
_SPELLINGS = {
    "uT": "µT",
    "uV": "µV",
    "us": "µs",
    "degC": "°C",
    "C": "°C",
    "degrees": "deg",
    "degree": "deg",
    "°": "deg",
    "radians": "rad",
    "ohm": "Ω",
    "Nm": "N·m",
}
_NAMES = {  # of units, for suggestions
    "ampere": "A",
    "amp": "A",
    "celsius": "°C",
    "gauss": "G",
    "gram": "g",
    "hertz": "Hz",
    "hour": "h",
    "joule": "J",
    "kelvin": "K",
    "kilogram": "kg",
    "meter": "m",
    "metre": "m",
    "minute": "min",
    "newton": "N",
    "pascal": "Pa",
    "percent": "%",
    "radian": "rad",
    "revolution": "rev",
    "sec": "s",
    "second": "s",
    "tesla": "T",
    "turn": "rev",
    "volt": "V",
    "watt": "W",
}
_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_TO_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_FACTOR = re.compile(r"^(1|[^\d\s^⁰¹²³⁴⁵⁶⁷⁸⁹⁻-]+)(?:\^?\(?(-?\d+)\)?)?$")


def _symbol(text: str) -> str:
    text = text.replace("μ", "µ")  # Greek mu to the micro sign
    return _SPELLINGS.get(text, text)


def _hint(symbol: str) -> str:
    """Return what to write instead of a symbol that is none."""
    known = {each.lower(): each for each in reversed(_BASE)}
    known |= {each.lower(): symbol for each, symbol in _SPELLINGS.items()} | _NAMES
    word = symbol.lower()
    found = known.get(word) or known.get(word.removesuffix("s"))
    close = [found] if found else difflib.get_close_matches(symbol, _BASE, n=1)
    if close:
        return f"did you mean {close[0]!r}?"
    return "write symbols, as in N·m, rad/s or m/s²; '1' is a number without a unit"


@cache
def parse(unit: object) -> tuple[tuple[str, int], ...]:
    """Parse a unit into ((symbol, exponent), ...) in canonical order. Raises ValueError if it is not a unit."""
    if not isinstance(unit, str):
        raise ValueError(f"a unit is a string, not {unit!r}")
    exponents: dict[str, int] = {}
    sign = 1
    text = unit.strip().replace("**", "^")
    for part in re.split(r"([*·⋅./])", text):
        part = part.strip()
        if part in "*·⋅.":
            if not part:
                raise ValueError(f"{unit!r} is not a unit; {_hint('')}")
            continue
        if part == "/":
            sign = -1
            continue
        match = _FACTOR.match(part.translate(_SUPERSCRIPTS))
        if not match:
            raise ValueError(f"{unit!r} is not a unit; {_hint('')}")
        symbol, exponent = _symbol(match[1]), int(match[2] or 1)
        if exponent == 0:  # such as g0, which would be a number without a unit
            raise ValueError(f"{unit!r} is not a unit: its {symbol} has the exponent 0")
        if symbol == "N·m":
            for symbol in ("N", "m"):
                exponents[symbol] = exponents.get(symbol, 0) + sign * exponent
            continue
        if symbol == ONE:
            continue
        if symbol not in _BASE:
            named = repr(unit) if part == text else f"{symbol!r} in {unit!r}"
            raise ValueError(f"{named} is not a unit; {_hint(symbol)}")
        exponents[symbol] = exponents.get(symbol, 0) + sign * exponent
    return tuple(sorted(((s, e) for s, e in exponents.items() if e), key=lambda item: _ORDER[item[0]]))


def _write(exponents: Iterable[tuple[str, int]]) -> str:
    def power(symbol: str, exponent: int) -> str:
        return symbol if exponent == 1 else symbol + str(exponent).translate(_TO_SUPERSCRIPTS)

    above = [power(s, e) for s, e in exponents if e > 0]
    below = [power(s, -e) for s, e in exponents if e < 0]
    return ("·".join(above) or ONE) + "".join("/" + factor for factor in below)


@cache
def canonical(unit: str) -> str:
    """Return the canonical spelling of a unit: "N·m" for "N*m", "m/s²" for "m/s^2", "any" unchanged.

    Raises ValueError if it is not a unit.
    """
    return ANY if unit == ANY else _write(parse(unit))


def multiply(a: str, b: str) -> str:
    """Return the unit of a product; "any" if one factor has the unit "any"."""
    return _combine(a, b, 1)


def divide(a: str, b: str) -> str:
    """Return the unit of a quotient; "any" if the dividend or the divisor has the unit "any"."""
    return _combine(a, b, -1)


def _combine(a: str, b: str, sign: int) -> str:
    if ANY in (a, b):
        return ANY
    exponents = dict(parse(a))
    for symbol, exponent in parse(b):
        exponents[symbol] = exponents.get(symbol, 0) + sign * exponent
    return _write(sorted(((s, e) for s, e in exponents.items() if e), key=lambda item: _ORDER[item[0]]))


def scale(unit: str) -> tuple[float, dict[str, int]]:
    """Return the factor of a unit, and the exponents of its base units kg, m, s, A, rad and K. Raises ValueError."""
    factor = 1.0
    base: dict[str, int] = {}
    for symbol, exponent in parse(unit):
        unit_factor, unit_base = _BASE[symbol]
        factor *= unit_factor**exponent
        for name, power in unit_base.items():
            base[name] = base.get(name, 0) + power * exponent
    return factor, {name: power for name, power in base.items() if power}


def conversion(source: str, target: str) -> tuple[float, float]:
    """Return (factor, offset) with target = factor · source + offset.

    Raises ValueError for units of different dimensions.
    """
    source, target = canonical(source), canonical(target)
    if source == target:
        return 1.0, 0.0
    if ANY in (source, target):
        raise ValueError(f"cannot convert from {source!r} to {target!r}")
    source_factor, source_base = scale(source)
    target_factor, target_base = scale(target)
    if source_base != target_base:
        raise ValueError(f"{source} does not convert to {target}")
    offset = {("°C", "K"): 273.15, ("K", "°C"): -273.15}.get((source, target), 0.0)
    return source_factor / target_factor, offset


def convert(value: float, source: str, target: str) -> float:
    """Convert a value to another unit. Raises ValueError for units of different dimensions."""
    factor, offset = conversion(source, target)
    return value * factor + offset


def deg(angle: float) -> float:
    """Convert an angle from degrees to rad. Raises TypeError for a list or text."""
    if isinstance(angle, str) or is_row(angle):
        raise TypeError(f"deg() converts one number, got {angle!r}: convert each, as in (deg(-10), deg(90))")
    return math.radians(angle)


def parse_quantity(text: str, unit: str | None) -> float:
    """Parse a number with an optional unit, "60 deg", and return it in `unit`.

    unit : unit of the result; None for SI units, with angles in rad; "any" for a number without a unit

    Raises ValueError if the text is not a number, or its unit does not convert.
    """
    match = re.match(r"^\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?inf|nan)\s*(.*)$", text)
    if not match:
        raise ValueError(f"{text!r} is not a number")
    if re.match(r",\d", match[2]):
        raise ValueError(f"{text!r} is not a number: write a decimal point, as in 2.5")
    value = float(match[1])
    if not match[2]:
        return value
    if unit == ANY:
        raise ValueError(
            f"takes a number without a unit, got {text!r}: its unit is that of the signal wired to its block"
        )
    return (
        convert(value, match[2], unit)
        if unit is not None
        else value
        if canonical(match[2]) == "°C"
        else value * scale(match[2])[0]
    )
