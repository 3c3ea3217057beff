"""Common parts of magnetic encoders of a joint, and of their emulators."""

from __future__ import annotations

import math
from typing import Any

from blocks.chips import ChipDevice
from blocks.i2c import Round, Transfer
from cext.kernels import no_io
from graph import Input, Interval, Memory, Output, Param


class MagneticEncoder(ChipDevice):
    """Absolute angle of a joint: θ = ± 2π counts / codes − offset, within ±π.

    An angle without a magnet is not a sample: `age` grows, and after `timeout` the run ends in the safe stop.
    """

    abstract = True
    codes: int  # of a turn
    sample: Any  # step of a Transfer that reads one sample

    rate = Param(200.0, "1/s", "reads per second", above=0.0, max=2000.0, fixed=True)
    invert = Param(False, "1", "true if the joint turns against the encoder", fixed=True)
    offset = Param(0.0, "rad", "reading, in the direction of the joint, where the joint is at zero", fixed=True)

    position = Output("rad", "angle of the joint, within ±π")
    counts = Output("1", "code of the angle", dtype=int)
    magnet = Output("1", "0 good, 1 too weak, 2 too strong, 3 none, or the angle is invalid", dtype=int)
    age = Output("s", "time since the newest angle was read")
    errors = Output("1", "failed transfers since the start of the run", dtype=int)

    identity = Memory(0.0, "bus segment and address")

    def configure(self) -> None:
        super().configure()
        self.identity = self.own_identity()

    def output_range(self) -> dict[str, Interval]:
        return {
            "position": Interval(-math.pi, math.pi),
            "counts": Interval(0.0, self.codes - 1.0),
            "magnet": Interval(0.0, 3.0),
            "age": Interval(0.0),
            "errors": Interval(0.0),
        }

    def rounds(self) -> tuple[Round, ...]:
        return (Round(1.0 / self.rate, (Transfer(0, (self.sample,)),)),)


class EmulatedEncoder(ChipDevice):
    """Ports and parameters of an emulated magnetic encoder."""

    abstract = True

    rate, invert, offset = (MagneticEncoder.parameters[name] for name in ("rate", "invert", "offset"))

    position = Input("rad", "angle of the joint", default=0.0)
    magnet = Input("1", "0 good, 1 too weak, 2 too strong, 3 none", default=0, dtype=int)
    silent = Input("1", "true stops all replies", default=False, dtype=bool)
    stuck = Input("1", "true repeats the last angle", default=False, dtype=bool)
    wrong_address = Input("1", "address or chip select used instead of its own; 0 for none", default=0, dtype=int)

    identity = Memory(0.0, "bus segment and address")
    state = Memory((0.0,) * 3, "time of the next reply, 1 while stuck, stuck code")

    timeout: Any = 0.0  # nothing replies to an emulator
    decode = no_io.ignore_all

    @classmethod
    def of(cls: Any, encoder: MagneticEncoder, **parameters: Any) -> Any:
        """Return the emulator of an encoder, with its parameters. parameters : that differ"""
        return cls(**{name: getattr(encoder, name) for name in cls.parameters} | parameters)

    def configure(self) -> None:
        super().configure()
        self.identity = self.own_identity()
