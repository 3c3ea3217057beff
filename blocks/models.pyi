# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Any, NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.declarations import Live
from graph.signal import Operand, Signal
import numpy as np
from graph import Block, Input, Memory, Output, Param

KNEE_FLEXION: tuple[Any, ...]
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
class WalkingKnee(Block):
    stride_time: Param[float]
    start: Param[float]
    harmonics: Param[int]
    angle: Output
    velocity: Output
    acceleration: Output
    mean: Memory
    cosines: Memory
    sines: Memory
    at_start: Any
    def __init__(
        self,
        stride_time: float | Live = 1.1,
        start: float | Live = 0.0,
        harmonics: int = 6,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        angle: Signal
        velocity: Signal
        acceleration: Signal
    def __call__(self) -> Outputs: ...
class RecordedKnee(Block):
    file: Param[str]
    column: Param[str]
    angle: Output
    velocity: Output
    acceleration: Output
    rate: Memory
    angles: Memory
    velocities: Memory
    accelerations: Memory
    at_start: Any
    def __init__(self, file: str, column: str, **options: Unpack[BlockOptions]) -> None: ...
    class Outputs(NamedTuple):
        angle: Signal
        velocity: Signal
        acceleration: Signal
    def __call__(self) -> Outputs: ...
def read_column(file: str, column: str) -> tuple[np.ndarray, np.ndarray]: ...
def seam(angles: np.ndarray, window: int) -> int: ...
