# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.signal import Operand
from typing import Any
from graph import Device, Input, Memory, Param

G: float
class EmulatedOpenImu(Device):
    bus: Param[str]
    address: Param[int]
    model: Param[Literal['300RI', '335RI']]
    sends_temperature: Param[bool]
    rounds: Param[bool]
    accel: Input
    gyro: Input
    mag: Input
    roll: Input
    pitch: Input
    temperature: Input
    silent: Input
    dropped: Input
    power_lost: Input
    stored: Memory
    state: Memory
    def __init__(
        self,
        bus: str = 'can',
        address: int = 128,
        model: Literal['300RI', '335RI'] = '300RI',
        sends_temperature: bool = False,
        rounds: bool = False,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    def __call__(
        self,
        accel: Operand = ...,
        gyro: Operand = ...,
        mag: Operand = ...,
        roll: Operand = ...,
        pitch: Operand = ...,
        temperature: Operand = ...,
        silent: Operand = ...,
        dropped: Operand = ...,
        power_lost: Operand = ...,
    ) -> EmulatedOpenImu: ...
    @classmethod
    def of(cls, imu: Device, **parameters: Any) -> EmulatedOpenImu: ...
    def addresses(self) -> list[tuple[int, bool]]: ...
