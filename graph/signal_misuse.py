"""Operations of Python and NumPy that signals do not support, and the blocks to use instead."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NoReturn

COMPARE = (
    'compare with Compare("{0}")(a, b), and choose with Switch (both from blocks.logic); for max() and min() use Max '
    "and Min (from blocks.mathematics)"
)
OWN = "write a block, with @block (from graph) or as a subclass of Block"
FUNCTION = f"use a block such as Sin or SquareRoot (`python -m runtime blocks` lists all), or {OWN}"
LOGIC = "use {} (from blocks.logic)"
MATHEMATICS = "use {} (from blocks.mathematics)"
TRIGONOMETRY = "use {} (from blocks.trigonometry)"
READ = "connect a recorder and read the recording after the run, as in trial['left/knee.position']"
STACK = "combine signals with stack(a, b, c) (from graph)"

OPERATORS = {  # {method: (operation, remedy)}
    "__lt__": ("<", COMPARE.format("<")),
    "__le__": ("<=", COMPARE.format("<=")),
    "__gt__": (">", COMPARE.format(">")),
    "__ge__": (">=", COMPARE.format(">=")),
    "__abs__": ("abs()", MATHEMATICS.format("Abs")),
    "__pow__": ("**", MATHEMATICS.format("Power")),
    "__rpow__": ("**", OWN),
    "__mod__": ("%", OWN),
    "__rmod__": ("%", OWN),
    "__floordiv__": ("//", MATHEMATICS.format("Round")),
    "__rfloordiv__": ("//", MATHEMATICS.format("Round")),
    "__round__": ("round()", MATHEMATICS.format("Round")),
    "__and__": ("&", LOGIC.format("And")),
    "__rand__": ("&", LOGIC.format("And")),
    "__or__": ("|", LOGIC.format("Or")),
    "__ror__": ("|", LOGIC.format("Or")),
    "__xor__": ("^", LOGIC.format("Xor") + "; a power is Power (from blocks.mathematics)"),
    "__rxor__": ("^", LOGIC.format("Xor")),
    "__invert__": ("~", LOGIC.format("Not")),
    "__bool__": ("if, and, or, not or bool()", LOGIC.format("Switch, And, Or, Not")),
    "__float__": ("float() or a function of math", FUNCTION),
    "__int__": ("int()", MATHEMATICS.format("Round")),
    "__len__": ("len()", "use the shape that its block declares"),
    "__iter__": ("iterating", "select elements with an index, as in signal[0], if it is a vector"),
    "__array__": ("numpy.array()", STACK),
}
NUMPY = {  # {function: remedy}
    **{name: TRIGONOMETRY.format(name.capitalize()) for name in ("sin", "cos", "tan")},
    **{f"arc{name}": TRIGONOMETRY.format(f"A{name}") for name in ("sin", "cos", "tan", "tan2")},
    "sqrt": MATHEMATICS.format("SquareRoot"),
    "square": MATHEMATICS.format("Power"),
    "power": MATHEMATICS.format("Power"),
    "absolute": MATHEMATICS.format("Abs"),
    "sign": MATHEMATICS.format("Sign"),
    "maximum": MATHEMATICS.format("Max"),
    "minimum": MATHEMATICS.format("Min"),
    **{name: MATHEMATICS.format("Round") for name in ("floor", "ceil", "rint", "round", "around")},
    "clip": "use Saturation (from blocks.limiters)",
    "where": LOGIC.format("Switch"),
    "interp": "use LookupTable1D (from blocks.tables)",
    "polyval": MATHEMATICS.format("Polynomial"),
    **{f"logical_{name.lower()}": LOGIC.format(name) for name in ("And", "Or", "Not", "Xor")},
    **{name: STACK for name in ("stack", "concatenate", "hstack", "vstack")},
    **{name: 'convert the unit with signal.to("rad")' for name in ("deg2rad", "radians")},
    **{name: 'convert the unit with signal.to("deg")' for name in ("rad2deg", "degrees")},
}
ATTRIBUTES = {  # {attribute of arrays: remedy}
    **dict.fromkeys(("unit", "units", "shape", "dtype"), "read its declaration, as in signal.declaration.unit"),
    "name": "use its path, as in signal.path",
    **dict.fromkeys(("abs", "clip", "diff", "filter", "integrate", "max", "mean", "min", "std", "sum"), FUNCTION),
}
ARITHMETIC = {  # {ufunc: function of the module operator}, so that numpy.float64(2.0) * signal is as 2.0 * signal
    "add": "add",
    "subtract": "sub",
    "multiply": "mul",
    "divide": "truediv",
    "negative": "neg",
    "less": "lt",
    "less_equal": "le",
    "greater": "gt",
    "greater_equal": "ge",
    "equal": "eq",
    "not_equal": "ne",
}


class WithoutValue:
    """Base class of Signal: operations on a value raise TypeError with the block to use instead."""

    if TYPE_CHECKING:

        @property
        def path(self) -> str: ...

    def __format__(self, form: str) -> str:
        if form:
            self.reject(f"the format {form!r}", READ)
        return str(self)

    def reject(self, operation: str, remedy: str) -> NoReturn:
        """Raise TypeError for an operation, with its remedy."""
        raise TypeError(
            f"{self.path} is a signal, which has no value until the diagram runs: instead of {operation}, {remedy}"
        )

    def __array_ufunc__(self, function: Any, method: str, *operands: Any, **options: Any) -> Any:
        """Apply an operator that signals support; reject every other function of NumPy."""
        name = function.__name__
        if name in ARITHMETIC and method == "__call__" and not options:
            return getattr(operator, ARITHMETIC[name])(*(plain(operand) for operand in operands))
        self.reject(f"numpy.{name}", NUMPY.get(name, FUNCTION))
        return None

    def __array_function__(self, function: Any, types: Any, arguments: Any, named: Any) -> Any:
        """Reject a function of NumPy that is not a ufunc."""
        self.reject(f"numpy.{function.__name__}", NUMPY.get(function.__name__, FUNCTION))


def missing(signal: WithoutValue, name: str) -> NoReturn:
    """Raise AttributeError for an attribute that signals do not have, with its remedy unless it is not a user's."""
    text = f"{type(signal).__name__!r} object has no attribute {name!r}"
    if name[0] != "_" and name not in ("block", "port", "path", "declaration"):  # as of a copy that is not yet complete
        remedy = ATTRIBUTES.get(name, f"it has no value until the diagram runs: {READ}")
        text = f"{signal.path} is a signal, which has no attribute {name!r}; {remedy}"
    raise AttributeError(text, name=name, obj=signal)


def plain(operand: Any) -> Any:
    """Return a scalar of NumPy as a Python number, and an array as a list; anything else as it is.

    Their own operators would call NumPy's function again.
    """
    return operand.tolist() if hasattr(operand, "tolist") else operand


def rejecting(operation: str, remedy: str) -> Callable[..., NoReturn]:
    """Return a method that rejects an operation."""

    def method(self: WithoutValue, *_: Any, **__: Any) -> NoReturn:
        self.reject(operation, remedy)

    return method


for name, (operation, remedy) in OPERATORS.items():  # set here, so that type checkers report these operations
    setattr(WithoutValue, name, rejecting(operation, remedy))
setattr(WithoutValue, "__getattr__", missing)  # noqa: B010  # for the same reason
