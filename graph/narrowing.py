"""Types of values from users and files: after `isinstance` a type checker does not know the type of their elements."""

from typing import Any, TypeGuard


def is_tuple(value: object) -> TypeGuard[tuple[Any, ...]]:
    """Return whether a value is a tuple."""
    return isinstance(value, tuple)


def is_row(value: object) -> TypeGuard[list[Any] | tuple[Any, ...]]:
    """Return whether a value is a list or a tuple."""
    return isinstance(value, (list, tuple))


def is_table(value: object) -> TypeGuard[dict[Any, Any]]:
    """Return whether a value is a dict."""
    return isinstance(value, dict)


def is_iterable(value: Any) -> bool:
    """Return whether a value can be iterated: no text, and no array without a dimension."""
    return hasattr(value, "__iter__") and not isinstance(value, (str, bytes)) and getattr(value, "ndim", 1) != 0


def are_names(value: Any) -> bool:
    """Return whether a value is a collection of texts."""
    return is_iterable(value) and hasattr(value, "__len__") and all(isinstance(name, str) for name in value)
