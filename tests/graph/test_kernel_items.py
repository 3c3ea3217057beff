"""A kernel finds its items by position: a class that inherits one and shifts them is refused when it is made."""

import math

import pytest

from blocks.actuators import CubeMars
from blocks.discrete import Integrator
from blocks.filters import Butterworth
from blocks.limiters import RMSTorqueLimiter, TorqueLimiter
from blocks.logic import Compare
from blocks.mathematics import Round
from cext.kernels import limiters as kernels
from graph import Block, Diagram, Input, Interval, Memory, Output, Param, compile
from graph.conformance import check_block
from tests.blocks.running import player, run


def refusal(make):
    with pytest.raises(TypeError) as error:
        make()
    return str(error.value)


def a_subclass(*bases, **body):
    return lambda: type("WearerLimiter", bases, {"__doc__": "A limiter for a wearer.", **body})


def test_a_parameter_more_is_refused_with_the_cure():
    assert refusal(a_subclass(RMSTorqueLimiter, mass=Param(70.0, "kg", "of the wearer", min=0.0))) == (
        "WearerLimiter adds the parameter 'mass' to RMSTorqueLimiter, whose kernel finds its items by position: "
        "declare it with kernel=False and "
        "fixed=True, give the class a kernel of its own, or wrap the block in a subsystem"
    )


def test_an_input_more_would_make_the_output_a_parameter_and_is_refused():
    said = refusal(a_subclass(TorqueLimiter, velocity=Input("rad/s", "of the joint", default=0.0)))
    assert said.startswith(
        "WearerLimiter adds the input 'velocity' to TorqueLimiter, whose kernel finds its items "
        "by position: give the class"
    )


@pytest.mark.parametrize(
    "body, said",
    [
        ({"peak": Output("N·m", "largest")}, "adds the output 'peak' to"),
        ({"count": Memory(0.0, "of ticks")}, "adds the memory 'count' to"),
        ({"window": 20.0}, "removes the parameter 'window' of"),
        ({"fade": Param(1.0, "s", "gentleness", fixed=True, kernel=False)}, "removes the parameter 'fade' of"),
        ({"limited": Output("N·m", "let through", kernel=False)}, "removes the output 'limited' of"),
        ({"window": Param("long", "s", "over which")}, "removes the parameter 'window' of"),
        ({"torque": Input("N·m", "asked for", shape=...)}, "changes the shape of the input 'torque' of"),
        ({"squares": Param(1.0, "1", "a memory that became a parameter")}, "adds the parameter 'squares' to"),
    ],
)
def test_whatever_shifts_an_item_is_refused(body, said):
    assert f"WearerLimiter {said} RMSTorqueLimiter" in refusal(a_subclass(RMSTorqueLimiter, **body))


def test_items_that_come_with_another_base_are_refused_whichever_stands_first():
    class Weighed(Block):
        """Something with a mass."""

        mass = Param(70.0, "kg", "of the wearer", min=0.0)

    for bases in ((Weighed, TorqueLimiter), (TorqueLimiter, Weighed)):
        assert "adds the parameter 'mass' to TorqueLimiter" in refusal(a_subclass(*bases))


def test_items_in_another_order_are_refused():
    class Swapped(Block):
        """The parameters of a limiter, the other way round."""

        slew = Param(1.0, "N·m/s", "fastest change", min=0.0)
        limit = Param(1.0, "N·m", "largest torque", min=0.0)

    assert "changes the place of the parameter" in refusal(a_subclass(TorqueLimiter, Swapped))


@pytest.mark.parametrize("kind", [Round, Compare, Integrator])
def test_a_kernel_that_is_chosen_when_the_block_is_configured_is_guarded_too(kind):
    assert f"to {kind.__name__}, whose kernel" in refusal(a_subclass(kind, mass=Param(70.0, "kg", "of the wearer")))


def test_a_subclass_of_a_subclass_is_held_against_the_same_items():
    class Gentle(TorqueLimiter):
        """A limiter that changes nothing but a default."""

        slew = Param(10.0, "N·m/s", "fastest change", min=0.0)

    assert "adds the parameter 'mass' to Gentle" in refusal(a_subclass(Gentle, mass=Param(70.0, "kg", "of the wearer")))


def test_a_device_whose_frames_are_encoded_by_position_is_guarded():
    assert "adds the parameter 'mass' to CubeMars, whose decode" in refusal(
        a_subclass(CubeMars, mass=Param(70.0, "kg", "of the wearer"))
    )
    a_subclass(CubeMars, mass=Param(70.0, "kg", "of the wearer", fixed=True, kernel=False))()


def test_a_filter_is_made_to_be_extended_and_what_is_made_of_it_is_not():
    assert "adds the parameter 'mass' to Butterworth" in refusal(
        a_subclass(Butterworth, mass=Param(70.0, "kg", "of the wearer"))
    )


# What stays allowed


class Rated(RMSTorqueLimiter):
    """Bounds the root mean square of a torque for a wearer, whose mass it keeps."""

    limit = Param(3.0, "N·m", "what a wearer of 70 kg is allowed", min=0.0, max=1e6)
    window = Param(0.05, "s", "a short one", above=0.0, fixed=True)
    fade = Param(0.01, "s", "shorter still", min=0.0, fixed=True)
    mass = Param(70.0, "kg", "of the wearer", min=1.0, max=200.0, fixed=True, kernel=False)

    examples = ({},)


def test_a_parameter_that_no_kernel_counts_and_other_defaults_are_allowed_and_the_limit_holds():
    with Diagram("wearer", rate=200) as diagram:
        Rated(mass=140.0, name="limiter")(player([100.0] * 200, "N·m"))
    limited = run(diagram, 200)["limiter.limited"]
    rms = max((sum(limited[k : k + 10] ** 2) / 10) ** 0.5 for k in range(190))
    assert 2.95 < rms <= 3.0 and check_block(Rated) > 0


def test_a_class_with_a_kernel_of_its_own_counts_its_own_items():
    class Own(RMSTorqueLimiter):
        """A limiter whose author names the kernel again, and so answers for its items."""

        mass = Param(70.0, "kg", "of the wearer")
        kernel = kernels.rms_torque

    assert list(Own.parameters)[-1] == "mass"


def test_a_step_in_python_replaces_the_kernels_and_may_have_any_items():
    class InPython(Butterworth):
        """A filter whose author wrote the step anew."""

        gain = Param(2.0, "1", "factor")

        def step(self, u):
            return self.gain * u

        def output_range(self, u):
            return Interval(-math.inf, math.inf)

    with Diagram("python", rate=200) as diagram:
        InPython(name="filter")(player([1.0, 2.0]))
    assert compile(diagram).settle == [] and run(diagram, 2)["filter.y"].tolist() == [2.0, 4.0]


def test_a_class_without_a_kernel_may_not_choose_one_for_its_instances_alone():
    class Secret(Block):
        """A block whose kernel is nowhere to be seen."""

        lower = Param(-1.0, "any", "smallest output")
        upper = Param(1.0, "any", "largest output")
        u = Input("any", "input", shape=...)
        y = Output("any", "clipped", shape=...)

        def configure(self):
            self.kernel = kernels.saturation

    assert refusal(Secret) == (
        "Secret chooses its kernel in configure: name one of them on the class too, so that "
        "its subclasses are checked "
        "against it"
    )


def test_check_block_refuses_a_class_whose_items_were_changed_afterwards():
    class Late(TorqueLimiter):
        """A limiter that is changed once it is made."""

        examples = ({"limit": 2.0},)

    check_block(Late)
    Late.parameters = {"mass": Param(70.0, "kg", "of the wearer").named("mass"), **Late.parameters}
    with pytest.raises(AssertionError, match="adds the parameter 'mass' to TorqueLimiter"):
        check_block(Late)
