"""Parameters that only `make soak` tries."""

from itertools import product

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


def crossed(*choices):
    """All combinations of choices, of which `make test` tries as few as it takes to try each choice.

    choices : for each parameter of the test, its values
    """
    choices = [list(values) for values in choices]
    places = list(product(*(range(len(values)) for values in choices)))
    few = {tuple(number % len(values) for values in choices) for number in range(max(map(len, choices)))}
    combinations = [tuple(values[place] for values, place in zip(choices, chosen)) for chosen in places]
    return soaked(combinations, but=[number for number, chosen in enumerate(places) if chosen in few])
