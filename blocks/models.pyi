# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from graph import Block, Input, Memory, Output, Param

class Limb(Block):
    inertia: Param[float]
    damping: Param[float]
    stiffness: Param[float]
    reflex: Param[float]
    start: Param[float]
    lower: Param[float]
    ligament: Param[float]
    torque: Input
    angle: Input
    rate: Input
    acceleration: Input
    position: Output
    velocity: Output
    state: Memory
    def __init__(
        self,
        inertia: float | Live = 0.35,
        damping: float | Live = 1.0,
        stiffness: float | Live = 120.0,
        reflex: float | Live = 8.0,
        start: float = 0.0,
        lower: float | Live = ...,
        ligament: float | Live = 500.0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        position: Signal
        velocity: Signal
    def __call__(
        self,
        torque: Operand = ...,
        angle: Operand = ...,
        rate: Operand = ...,
        acceleration: Operand = ...,
    ) -> Outputs: ...
