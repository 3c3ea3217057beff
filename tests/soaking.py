"""Parameters that only `make soak` tries."""

import pytest


def soaked(values, but):
    """Parameters of a test, of which `make test` tries a few, and `make soak` the others.

    values : each a value, or a tuple of values
    but : places of those that `make test` tries
    """
    return [
        value
        if place in but
        else pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=pytest.mark.soak)
        for place, value in enumerate(values)
    ]
