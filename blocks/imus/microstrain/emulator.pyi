# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal, NamedTuple
from collections.abc import Sequence
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from typing import Any
from blocks.imus.microstrain import models
from graph import Device, Input, Memory, Output, Param

FIELD_LIMIT: int
INFO: int
class EmulatedMicroStrain(Device):
    bus: Param[str]
    model: Param[str]
    serial: Param[str]
    rate: Param[float]
    channels: Param[Sequence[Any] | np.ndarray]
    attitude: Param[Literal['filter', 'sensor']]
    sensor_to_vehicle: Param[Sequence[Any] | np.ndarray]
    streaming_at_start: Param[bool]
    clock_error: Param[float]
    clock_start: Param[float]
    seed: Param[int]
    accel: Input
    gyro: Input
    mag: Input
    quaternion: Input
    temperature: Input
    silent: Input
    garbage: Input
    dropped: Input
    flipped: Input
    skipped: Input
    not_a_number: Input
    uninitialised: Input
    disconnected: Input
    streaming: Output
    heading: Output
    cutoff: Output
    sent: Output
    about: Memory
    known: Memory
    settings: Memory
    power_on: Memory
    registers: Memory
    state: Memory
    spec: Any
    def __init__(
        self,
        bus: str = 'imu',
        model: str = '3DM-GX5-25',
        serial: str = '133931',
        rate: float = 200.0,
        channels: Sequence[Any] | np.ndarray = ...,
        attitude: Literal['filter', 'sensor'] = 'filter',
        sensor_to_vehicle: Sequence[Any] | np.ndarray = ...,
        streaming_at_start: bool = True,
        clock_error: float = 0.0,
        clock_start: float = 1000.0,
        seed: int = 1,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        streaming: Signal
        heading: Signal
        cutoff: Signal
        sent: Signal
    def __call__(
        self,
        accel: Operand = ...,
        gyro: Operand = ...,
        mag: Operand = ...,
        quaternion: Operand = ...,
        temperature: Operand = ...,
        silent: Operand = ...,
        garbage: Operand = ...,
        dropped: Operand = ...,
        flipped: Operand = ...,
        skipped: Operand = ...,
        not_a_number: Operand = ...,
        uninitialised: Operand = ...,
        disconnected: Operand = ...,
    ) -> Outputs: ...
    @classmethod
    def of(cls, sensor: Any, **parameters: Any) -> EmulatedMicroStrain: ...
    def register(self, setting: models.Setting) -> tuple[float, ...]: ...
    def saved(self, descriptor_set: int, decimation: int) -> tuple[float, ...]: ...
