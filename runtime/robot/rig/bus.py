"""Interface of a logical bus, as a rig file names it."""

from dataclasses import dataclass, field
from typing import Any

BITRATE_MAXIMUM = 1_000_000  # bit/s, of classic CAN
DATA_BITRATE_MAXIMUM = 8_000_000  # bit/s, of CAN FD


@dataclass(frozen=True)
class RigBus:
    """Interface of a logical bus.

    interface : kind of python-can, udp, i2c or spi
    channel : name of the interface
    bitrate : bit/s; of SPI the clock
    fd : whether it carries CAN FD
    data_bitrate : bit/s of the data phase of CAN FD frames; 0: they do not switch the bitrate
    peer : destination of UDP datagrams, "" for none
    key : file with the key that signs UDP datagrams, "" for unsigned ones
    options : further arguments of the python-can interface
    """

    name: str
    interface: str
    channel: str
    bitrate: int = BITRATE_MAXIMUM
    fd: bool = False
    data_bitrate: int = 0
    peer: str = ""
    key: str = ""
    options: dict[str, Any] = field(default_factory=dict)
