# Generated from the declarations by `python -m graph.stubs`. Do not edit.
from typing import Literal, NamedTuple
from typing_extensions import Unpack
from graph.block import BlockOptions
from graph.signal import Signal
from typing import Any
from graph import Device, Memory, Output, Param

NEEDED: dict[Any, Any]
SIGNS: dict[Any, Any]
class OpenImu(Device):
    bus: Param[str]
    address: Param[int]
    model: Param[Literal['300RI', '335RI']]
    rate: Param[float]
    field: Param[bool]
    slope: Param[bool]
    slope_sensor: Param[int]
    high_resolution: Param[bool]
    rate_filter: Param[int]
    acceleration_filter: Param[int]
    orientation: Param[int]
    axes: Param[Literal['printed', 'z up']]
    write_settings: Param[bool]
    bitrate: Param[float]
    timeout: Param[float]
    accel: Output
    gyro: Output
    mag: Output
    roll: Output
    pitch: Output
    temperature: Output
    age: Output
    settings: Output
    invalid: Output
    wanted: Memory
    set_up: Memory
    state: Memory
    types: Any
    divider: Any
    def __init__(
        self,
        bus: str = 'can',
        address: int = 128,
        model: Literal['300RI', '335RI'] = '300RI',
        rate: float = 100.0,
        field: bool = True,
        slope: bool = False,
        slope_sensor: int = 2,
        high_resolution: bool = False,
        rate_filter: int = 25,
        acceleration_filter: int = 25,
        orientation: int = 0,
        axes: Literal['printed', 'z up'] = 'printed',
        write_settings: bool = True,
        bitrate: float = 250000.0,
        timeout: float = 0.1,
        **options: Unpack[BlockOptions],
    ) -> None: ...
    class Outputs(NamedTuple):
        accel: Signal
        gyro: Signal
        mag: Signal
        roll: Signal
        pitch: Signal
        temperature: Signal
        age: Signal
        settings: Signal
        invalid: Signal
    def __call__(self) -> Outputs: ...
    def enable_frames(self) -> list[tuple[int, bool, bytes]]: ...
    def addresses(self) -> list[tuple[int, bool]]: ...
    def acceptance_filters(self) -> list[tuple[int, int, bool]]: ...
    def reports(self) -> list[tuple[float, int, bool]]: ...
    def emulator(self, **parameters: Any) -> Any: ...
