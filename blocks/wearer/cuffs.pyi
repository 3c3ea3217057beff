# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
from graph import Block, Input, Memory, Output, Param

class Cuff(Block):
    lever: Param[float]
    stiffness: Param[float]
    relaxation: Param[float]
    gain: Param[float]
    zero: Param[float]
    zero_drift: Param[float]
    noise: Param[float]
    seed: Param[int]
    torque: Input
    angle: Input
    velocity: Input
    position: Output
    speed: Output
    force: Output
    measured: Output
    state: Memory
    def __init__(
        self,
        lever: float | Live = 0.3,
        stiffness: float | Live = 4500.0,
        relaxation: float | Live = 0.02,
        gain: float | Live = 1.0,
        zero: float | Live = 0.0,
        zero_drift: float = 0.0,
        noise: float | Live = 0.0,
        seed: int = 0,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        position: Signal
        speed: Signal
        force: Signal
        measured: Signal
    def __call__(self, torque: Operand = ..., angle: Operand = ..., velocity: Operand = ...) -> Outputs: ...
