"""Blocks from functions."""

import math

import pytest

from graph import Diagram, Input, Output, Param, block, compile
from graph.conformance import check_block


@block
def spring(angle: Input("rad", "joint angle"), stiffness: Param(30.0, "N·m/rad", "K", min=0.0)) -> Output(
    "N·m", "torque"
):
    """Virtual spring: τ = -K θ."""
    return -stiffness * angle


@block
def polar(
    x: Input("m", "east"), y: Input("m", "north"), t
) -> {"radius": Output("m", "distance"), "angle": Output("rad", "bearing")}:  # noqa: F821  (names of outputs)
    """Polar coordinates, ready from t = 0 on."""
    return math.hypot(x, y) if t >= 0 else math.nan, math.atan2(y, x)


def test_the_signature_of_a_function_declares_its_block():
    assert spring(stiffness=2.0).step(3.0) == -6.0
    assert (
        list(spring.inputs) == ["angle"] and spring.inputs["angle"].unit == "rad" and spring.outputs["y"].unit == "N·m"
    )
    assert polar().step(3.0, 4.0, 0.0) == (5.0, math.atan2(4.0, 3.0))


def test_a_function_block_passes_the_conformance_test():
    assert check_block(spring) == check_block(polar) == 10


def test_a_function_block_is_wired_like_any_other():
    with Diagram("d", rate=100) as diagram:
        spring(stiffness=5.0)(angle=polar()(3.0, 4.0).angle)
    assert [step.name for step in compile(diagram).output] == ["polar", "spring"]


def test_a_signature_that_is_incomplete_is_refused_when_decorating():
    with pytest.raises(TypeError, match=r"bare has no return annotation: add -> Output\(unit\)"):

        @block
        def bare(u: Input("1")):
            return u

    with pytest.raises(TypeError, match=r"vague: annotate u with Input\(unit\) or Param\(default, unit\)"):

        @block
        def vague(u) -> Output("1"):
            return u

    with pytest.raises(TypeError, match="the name 'u' is used twice"):

        @block
        def twice(u: Input("1")) -> {"u": Output("1")}:  # noqa: F821  (names of outputs)
            return u
