"""Assignments to a diagram and its blocks: what cannot be valid is refused where it is assigned, or by the compile."""

import copy
import pickle

import numpy as np
import pytest

from blocks.filters import Butterworth
from blocks.limiters import Saturation
from blocks.recorders import CsvRecorder
from blocks.sensors.ads1115 import ADS1115
from blocks.sources import Constant
from graph import Block, Diagram, DiagramError, Input, Live, Output, compile
from graph.declarations import Declared

NAMES = {"Live": Live, "Input": Input, "Output": Output, "Diagram": Diagram, "Constant": Constant}


def made():
    """Return a diagram, and its parts by name."""
    with Diagram("robot", rate=200) as diagram:
        source = Constant(0.5, name="source")
        limit = Saturation(-1.0, 1.0, name="limit")
        limit(source.y)
        CsvRecorder()
    return diagram, {**NAMES, "diagram": diagram, "source": source, "limit": limit}


@pytest.mark.parametrize("value", ["'100'", "None", "float('nan')", "-5", "0", "True", "10**400", "[200]", "2j"])
def test_a_rate_that_cannot_be_is_refused_at_the_line_that_assigns_it(value):
    diagram, names = made()
    with pytest.raises(DiagramError, match="the rate must be a number above 0 Hz") as caught:
        exec(builtin_compile(f"\ndiagram.rate = {value}"), names)
    assert caught.value.diagnostics[0].where.line == 2 and diagram.rate == 200


@pytest.mark.parametrize("value", ["None", "3", "''", "'a/b'", "'a\\nb'", "'x' * 500"])
def test_a_name_that_cannot_be_is_refused_at_the_line_that_assigns_it(value):
    _, names = made()
    with pytest.raises(DiagramError, match="cannot be a name") as caught:
        exec(builtin_compile(f"\ndiagram.name = {value}"), names)
    assert caught.value.diagnostics[0].where.line == 2


@pytest.mark.parametrize(
    "line, words",
    [
        ("diagram.solver = 'rk9'", "the solver must be one of"),
        ("diagram.solver = ['rk45']", "the solver must be one of"),
        ("diagram.tolerances = None", "rtol must be in"),
        ("diagram.tolerances = 'a', 'b'", "rtol must be in"),
        ("limit.inputs['u'] = 1.0", "'u' cannot be assigned: all blocks of a class share"),
        ("limit.inputs.clear()", "cannot be assigned: all blocks of a class share"),
        ("limit.inputs.pop('u')", "'u' cannot be assigned: all blocks of a class share"),
        ("del limit.parameters['lower']", "'lower' cannot be assigned: all blocks of a class share"),
        ("limit.parameters.update(lower=3)", "cannot be assigned: all blocks of a class share"),
        ("source.outputs['y'] = 3", "'y' cannot be assigned: all blocks of a class share"),
        ("limit.inputs['u'].unit = 'furlong'", "unit of Input('u', 'any') cannot be assigned"),
        ("limit.parameters['lower'].max = 5.0", "max of Param('lower') cannot be assigned"),
    ],
)
def test_an_assignment_to_what_is_fixed_is_refused(line, words):
    _, names = made()
    with pytest.raises((DiagramError, AttributeError)) as caught:
        exec(line, names)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    "line, words",
    [
        ("diagram.wires = None", "its wires were assigned, got None"),
        ("diagram.caps = []", "its caps were assigned, got []"),
        ("diagram.wires.append(3)", "its wires contain 3, which does not connect two of its blocks"),
        ("diagram.wire(source.y, limit, 'nope', None)", "which does not connect two of its blocks"),
        ("diagram.blocks['x'] = 3", "blocks['x'] is 3, which was not made in this diagram"),
        ("diagram.blocks['x'] = source", "blocks['x'] is <Constant source>, which was not made in this diagram"),
        ("del diagram.blocks['source']", "which does not connect two of its blocks"),
        ("limit.lower = 'x'", "limit: lower: expected a number, got 'x'"),
        ("limit.lower = None", "limit: lower: expected a value, got None"),
        ("limit.lower = [1.0, 2.0]", "limit: lower: expected one number, got [1.0, 2.0]"),
        ("limit.lower = ((1, 2), (3,))", "limit: lower: expected one number, got ((1, 2), (3,))"),
        ("limit.lower = 10**400", "limit: lower: expected a number of at most 1.8e308"),
        ("del limit.lower", "limit: lower: expected a value, got None"),
        ("limit.every = '2'", "limit: every must be a whole number of ticks, 1 or more, got '2'"),
        ("limit.every = 0", "limit: every must be a whole number of ticks, 1 or more, got 0"),
        ("limit.hold_exceptions = 'x'", "limit: hold_exceptions must be a whole number of steps in a row, got 'x'"),
        ("limit.conditions = True", "limit: conditions must be Signals, got True"),
        ("limit.inputs = None", "limit: inputs must be a dict of Input by name, got None"),
        ("limit.inputs = {'u': 1.0}", "limit: inputs must be a dict of Input by name, got {'u': 1.0}"),
        ("limit.outputs = {}", "limit: its outputs were assigned"),
        ("limit.path = ['x']", "blocks['limit'] is <Saturation ['x']>, which was not made in this diagram"),
        ("limit.diagram = None", "which was not made in this diagram at this path"),
        ("limit.allowance = float('nan')", "limit: allowance must be a time of 0 s or more, got nan"),
        ("limit.feedthrough = 3", "limit: feedthrough must be a tuple of names of inputs, or None, got 3"),
        ("limit.winds_up = 3", "limit: winds_up must be a dict of names of inputs, by name of an output, got 3"),
        ("limit.winds_up = {'y': 'nope'}", "limit: its winds_up takes 'nope', which is not an input"),
        ("limit.output_range = 3", "limit: output_range must be a method, got 3"),
    ],
)
def test_any_other_assignment_is_reported_by_the_compile_at_the_block(line, words):
    diagram, names = made()
    exec(line, names)
    for _ in range(2):  # and again: nothing of it was adopted
        with pytest.raises(DiagramError) as caught:
            compile(diagram)
        assert words in str(caught.value)
        if "limit:" in words:
            assert all(each.where.line == names["limit"].location.line for each in caught.value.diagnostics)


def builtin_compile(source):
    """Return the code of a source in a file of its own, as of a user."""
    return __builtins__["compile"](source, "assigning.py", "exec")


def test_all_wrong_parameters_are_reported_together():
    diagram, names = made()
    exec("limit.lower = 'x'; source.value = None", names)
    with pytest.raises(DiagramError) as caught:
        compile(diagram)
    assert [each.path for each in caught.value.diagnostics] == ["source", "limit"]


def test_configure_may_add_a_port_to_one_block_and_leaves_the_class_alone():
    class Own(Block):
        u = Input("1")
        y = Output("1")

        def configure(self):
            self.inputs |= {"v": Input("1", default=0.0).named("v")}

        def step(self, *inputs):
            return sum(inputs)

    with Diagram("d", rate=100) as diagram:
        Own()(Constant(1.0)(), 2.0)
        CsvRecorder()
    compile(diagram)
    assert list(Own.inputs) == ["u"] and isinstance(Own.inputs, Declared)


def test_declarations_are_copied_and_pickled():
    assert (
        dict(pickle.loads(pickle.dumps(Declared(a=1)))) == {"a": 1} and copy.copy(Butterworth.inputs["u"]).unit == "any"
    )


@pytest.mark.parametrize(
    "body, words",
    [
        ("feedthrough = 3", "Own.feedthrough must be a tuple of names of inputs, or None, got 3"),
        ("free_units = 'u'", "Own.free_units must be a tuple of names of inputs, got 'u'"),
        ("winds_up = 3", "Own.winds_up must be a dict of names of inputs"),
        ("allowance = 'x'", "Own.allowance must be a time of 0 s or more, got 'x'"),
        ("step = 3", "Own.step must be a method, got 3"),
        ("prepare = None", "Own.prepare must be a method, got None"),
        (
            "def prepare(self): pass",
            "Own.prepare cannot be called (too many positional arguments): define prepare(self, dt)",
        ),
        ("def run_summary(self, x): pass", "Own.run_summary cannot be called (missing a required argument: 'x')"),
        ("def instability(): pass", "Own.instability takes no `self`: define instability(self)"),
        ("continuous = True", "Own has continuous states: derive it from Continuous (of blocks.continuous)"),
        ("def __eq__(self, other): return True", "Own defines equality, but each block is equal to itself only"),
        ("v = Input('1', default='x')", "default must be a number or an array of numbers, got 'x'"),
        ("v = Input('1', default=[[1], [2, 3]])", "default must be a number or an array of numbers"),
        ("z = Output('1', range=('a', 'b'))", "range must be (low, high), as in (0.0, 1.0), got ('a', 'b')"),
    ],
)
def test_a_class_with_what_cannot_be_valid_is_refused(body, words):
    source = f"class Own(Block):\n    u = Input('1')\n    y = Output('1')\n    {body}\n"
    with pytest.raises(TypeError) as caught:
        exec(source, {**NAMES, "Block": Block})
    assert words in str(caught.value)


@pytest.mark.parametrize(
    "body, words",
    [
        ("def output_range(self): return None", "got an unexpected keyword argument 'u'"),
        ("def output_range(self, u): return 3", "output_range returned 3, and must return an Interval, or a dict"),
        ("def output_range(self, u): return {'y': 3}", "output_range returned {'y': 3}, and must return an Interval"),
        ("def output_units(self, u): return 3", "output_units returned 3, and must return a dict of units"),
        ("def instability(self): return 'x'", "instability returned 'x', and must return (reason, remedy) or None"),
        ("winds_up = {'y': 'nope'}", "its winds_up takes 'nope', which is not an input"),
        ("def configure(self): self.inputs = {'v': Input('1')}", "its step takes 'u', which is not an input"),
    ],
)
def test_a_hook_that_does_not_take_the_arguments_or_returns_something_else_is_reported(body, words):
    space = {**NAMES, "Block": Block}
    step = "def step(self, u): return u"
    exec(f"class Own(Block):\n    u = Input('1')\n    y = Output('1')\n    {step}\n    {body}\n", space)
    with Diagram("d", rate=100) as diagram:
        block = space["Own"](name="own")
        block(**dict.fromkeys(block.inputs, 0.0))
        CsvRecorder()
    with pytest.raises(DiagramError) as caught:
        compile(diagram)
    assert words in str(caught.value) and {each.path for each in caught.value.diagnostics} == {"own"}


def test_a_parameter_that_a_block_of_the_library_cannot_compute_with_is_named():
    with pytest.raises(DiagramError, match="cannot be made with channels=3: TypeError"), Diagram("d", rate=100):
        ADS1115(channels=3)


def test_names_that_are_an_array_without_a_dimension_are_refused():
    with pytest.raises(TypeError, match="smooth must be a tuple of names of inputs"):
        type("Law", (Block,), {"smooth": np.array(3)})
