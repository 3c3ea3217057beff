# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal
from collections.abc import Sequence
from typing_extensions import Unpack
import numpy as np
from graph.block import BlockOptions
from graph.signal import Operand, Signal
from collections.abc import Iterator
from typing import Any
from blocks.imus.microstrain.emulator import EmulatedMicroStrain
from graph import Input, Memory, Output, Param, StreamDevice

PLAIN: int
ATTITUDE: int
ANGLES: int
CLOCK: int
ENVELOPE: int
SHORTEST_TIME: int
SHORTEST_TIME_CONSTANT: float
LONGEST_TIME_CONSTANT: float
START_TARE_LIMIT: float
class MicroStrain(StreamDevice):
    serial: Param[str]
    port: Param[str]
    baudrate: Param[int]
    rate: Param[float]
    channels: Param[Sequence[Any] | np.ndarray]
    attitude: Param[Literal['filter', 'sensor']]
    heading: Param[Literal['', 'none', 'magnetometer']]
    up_compensation: Param[float | None]
    north_compensation: Param[float | None]
    sensor_to_vehicle: Param[Sequence[Any] | np.ndarray]
    low_pass: Param[float]
    anti_aliasing: Param[Literal['', 'on', 'off']]
    tare_at_start: Param[bool]
    tare_time: Param[float]
    timeout: Param[float]
    tare: Input
    accel: Output
    gyro: Output
    mag: Output
    quaternion: Output
    euler: Output
    rotation: Output
    raw_quaternion: Output
    raw_euler: Output
    temperature: Output
    age: Output
    sample_time: Output
    clock_drift: Output
    measured_rate: Output
    packets: Output
    corrupt: Output
    lost: Output
    valid: Output
    tared: Output
    tare_attitude: Output
    connected: Output
    pending: Memory
    index: Memory
    rows: Memory
    settings: Memory
    state: Memory
    fields: Any
    def __init__(
        self,
        serial: str = '',
        port: str = '',
        baudrate: int = 115200,
        rate: float = 200.0,
        channels: Sequence[Any] | np.ndarray = ...,
        attitude: Literal['filter', 'sensor'] = 'filter',
        heading: Literal['', 'none', 'magnetometer'] = '',
        up_compensation: float | None = None,
        north_compensation: float | None = None,
        sensor_to_vehicle: Sequence[Any] | np.ndarray = ...,
        low_pass: float = 0.0,
        anti_aliasing: Literal['', 'on', 'off'] = '',
        tare_at_start: bool = False,
        tare_time: float = 0.5,
        timeout: float = 0.1,
        bus: str = '',
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __getattr__(self, name: str) -> Signal: ...
    def __call__(self, tare: Operand = ...) -> Any: ...
    def check_filters(self) -> None: ...
    def tabulate(self) -> None: ...
    def opening(self) -> dict[str, int | str]: ...
    def sends(self) -> list[tuple[float, int]]: ...
    def line_speed(self) -> float: ...
    def set_up(self) -> Iterator[Any]: ...
    def emulator(self, **parameters: Any) -> EmulatedMicroStrain: ...
