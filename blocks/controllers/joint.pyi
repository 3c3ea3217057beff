# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from typing import Any
import numpy as np
from graph import Block, Input, Memory, Output, Param

GRAVITY: float
ZERO: Any
class Impedance(Block):
    stiffness: Param[float]
    damping: Param[float]
    position: Input
    velocity: Input
    equilibrium: Input
    extra_stiffness: Input
    extra_damping: Input
    torque: Output
    def __init__(
        self,
        stiffness: float | Live = 30.0,
        damping: float | Live = 1.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(
        self,
        position: Operand = ...,
        velocity: Operand = ...,
        equilibrium: Operand = ...,
        extra_stiffness: Operand = ...,
        extra_damping: Operand = ...,
    ) -> Signal: ...
class Admittance(Block):
    inertia: Param[float]
    damping: Param[float]
    stiffness: Param[float]
    torque: Input
    equilibrium: Input
    position: Output
    velocity: Output
    transition: Memory
    state: Memory
    def __init__(
        self,
        inertia: float = 0.5,
        damping: float = 5.0,
        stiffness: float = 30.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        position: Signal
        velocity: Signal
    def __call__(self, torque: Operand = ..., equilibrium: Operand = ...) -> Outputs: ...
    def design(self, dt: float) -> tuple[np.ndarray, np.ndarray]: ...
class FeedForward(Block):
    inertia: Param[float]
    damping: Param[float]
    friction: Param[float]
    slip: Param[float]
    velocity: Input
    acceleration: Input
    torque: Output
    def __init__(
        self,
        inertia: float | Live = 0.0,
        damping: float | Live = 0.0,
        friction: float | Live = 0.0,
        slip: float | Live = 0.1,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, velocity: Operand = ..., acceleration: Operand = ...) -> Signal: ...
class GravityCompensation(Block):
    mass: Param[float]
    length: Param[float]
    share: Param[float]
    angle: Input
    torque: Output
    def __init__(
        self,
        mass: float | Live = 3.0,
        length: float | Live = 0.2,
        share: float | Live = 1.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(self, angle: Operand = ...) -> Signal: ...
