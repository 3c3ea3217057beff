"""Objects of user code with a hostile text, where the language prints them: the error names them all the same."""

import itertools
import time

import pytest

from graph import Block, Diagram, DiagramError, Input, Output, Param, subsystem
from graph.drawing.cards import parameter_cards


def raises():
    raise ValueError("no text")


def hangs():
    for _ in itertools.count():
        pass


def hostile(form, kind=object):
    return type("Hostile", (kind,), {"__repr__": lambda self: form(), "__str__": lambda self: form()})()


FORMS = pytest.mark.parametrize(
    "form, text", [(raises, "(no text: it raised ValueError)"), (hangs, "(no text within 20 ms)")]
)


class Follower(Block):
    """A block with a parameter of each kind."""

    u = Input("any")
    y = Output("any")

    number = Param(1.0, "N·m")
    flag = Param(True)
    word = Param("a", choices=("a", "b"))

    def step(self, u):
        return u


class Unprepared(Follower):
    """A block whose preparation raises an exception."""

    def prepare(self, dt):
        raise hostile(type(self).form, ValueError)


def unprepared(value, form):
    Unprepared.form = form
    Unprepared(name="a")(1.0)


USES = {
    "rate": lambda value, form: Diagram("other", rate=value),
    "diagram name": lambda value, form: Diagram(value, rate=100),
    "block name": lambda value, form: Follower(name=value),
    "connection": lambda value, form: Follower()(value),
    "flag": lambda value, form: Follower(flag=value),
    "word": lambda value, form: Follower(word=value),
    "every": lambda value, form: Follower(every=value),
    "held": lambda value, form: Follower(hold_exceptions=value),
    "subsystem": lambda value, form: subsystem("left", every=value),
    "enabled": lambda value, form: subsystem("left", enabled=value),
    "exception": unprepared,
}


@FORMS
@pytest.mark.parametrize("use", USES)
def test_an_error_about_a_value_without_text_states_why_it_has_none(use, form, text):
    began = time.monotonic()
    with pytest.raises(DiagramError, match="TW0") as caught, Diagram("d", rate=100):
        USES[use](hostile(form), form)
    assert text in str(caught.value) and time.monotonic() - began < 5.0


@FORMS
def test_a_default_without_text_is_listed(form, text):
    kind = type("Odd", (Follower,), {"__doc__": "Odd.", "law": Param(hostile(form), "N·m", dtype=object)})
    [card] = [card for card in parameter_cards(kind) if card["name"] == "law"]
    assert card["default"] == text
