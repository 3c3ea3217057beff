"""Neural networks in ONNX form, run by ONNX Runtime."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from blocks._plumbing.network_ports import Description, describe, tensors
from cext.kernels.networks import inference as kernels
from cext.kernels.networks.model import PROVIDERS, Model
from graph import Block, Input, Interval, Memory, Output, Param

LAYOUTS = ("channels, time", "time, channels")
RATE_TOLERANCE = 1e-6  # relative difference of two equal rates
FLOATS_PER_DOUBLE = 2


class OnnxModel(Block):
    """Neural network in an ONNX file, with one input per channel and one output per result of the network.

    Names, units, normalisation and ranges of the ports are those in the file's metadata, or `channels` and `results`,
    as in `channels=({"name": "hip_angle", "unit": "rad", "mean": 0.2, "std": 0.4},)`. The network receives
    (x - mean) / std, and y = y_network · std + mean is clipped to `range`. NaN passes, and infinity becomes NaN.

    A network with one input, of shape (1, channels, samples), receives the last samples of each channel. A network with
    further inputs is a streaming one: it receives one sample, and its output NAME_next is the next value of its input
    NAME, which is 0 at the start. Until the network has received enough samples, its outputs have the value nearest to
    0 in their range, and `valid` is false. Requires ONNX Runtime: `pip install 'tickwork[networks]'`.
    """

    file = Param(
        "",
        "1",
        "path of the ONNX file: absolute, or relative to the folder of the diagram or the working folder",
        required=True,
        dtype=str,
        file=True,
    )
    channels = Param((), "1", "inputs of the network, each with name, unit, mean and std; by default those in the file")
    results = Param(
        (), "1", "outputs of the network, each with name, unit, range, mean and std; by default those in the file"
    )
    rate = Param(
        0.0,
        "Hz",
        "sampling rate of the network, by default that in the file; the block runs at this rate unless it has `every`",
        min=0.0,
        fixed=True,
        kernel=False,
    )
    layout = Param(LAYOUTS[0], "1", "order of the dimensions of the window", choices=LAYOUTS)
    provider = Param("cpu", "1", "execution provider of ONNX Runtime", choices=tuple(PROVIDERS))

    valid = Output("1", "true once the network has received enough samples", dtype=bool)
    age = Output("s", "time since the newest sample that the outputs are computed from")
    overruns = Output("1", "number of results that were not ready in time", dtype=int)
    model = Memory(0.0, "address of the loaded model")
    plan = Memory((1.0, 0.0, 1.0), "samples of the window, 1 if time is its first dimension, samples until valid")
    channel_scales = Memory(0.0, "mean and standard deviation of each channel")
    output_scales = Memory(0.0, "mean, standard deviation and range of each output")
    operands = Memory(0.0, "samples and states, in single precision")
    computed = Memory(0.0, "results and next states, in single precision")
    count = Memory(0.0, "samples received")

    kernel = kernels.tick

    def configure(self) -> None:
        self.file = str(self.path_of_file())
        try:
            loaded = Model(Path(self.file).read_bytes(), self.provider)
            self.description = describe(loaded.metadata, self.channels, self.results, reserved=_RESERVED_NAMES)
            inputs, outputs, samples = tensors(loaded, self.description, self.layout == LAYOUTS[1])
        except ValueError as error:
            raise ValueError(f"{self.file}: {error}") from None
        loaded.arrange(inputs, outputs, len(outputs) - len(inputs) + 1)
        self.place(loaded, samples, streaming=len(inputs) > 1)
        self.set_rate()

    def path_of_file(self) -> Path:
        """Return the path of the ONNX file. Raises ValueError if there is none."""
        folder = Path(self.location.file).parent if self.location else Path()
        for path in (folder / self.file, Path(self.file)):
            if path.is_file():
                return path
        raise ValueError(f"file: there is no {self.file} in {folder or '.'} or in the working folder")

    def place(self, loaded: Any, samples: int, *, streaming: bool) -> None:
        """Set the ports and the memory of a loaded Model. samples : of the window"""
        declared: Description = self.description
        self.inputs = {
            each.name: Input(each.unit, each.description or "channel of the network").named(each.name)
            for each in declared.channels
        }
        self.outputs = {
            each.name: Output(each.unit, each.description or "result of the network", range=each.range).named(each.name)
            for each in declared.results
        } | type(self).outputs
        operands, results = loaded.sizes
        needed = declared.receptive_field if streaming else samples
        self.kernel = kernels.tick.owned(loaded)
        self.model = loaded.address
        self.plan = (float(samples), float(self.layout == LAYOUTS[1]), float(needed))
        self.channel_scales = [x for each in declared.channels for x in (each.mean, each.std)]
        self.output_scales = [x for each in declared.results for x in (each.mean, each.std, *each.limits)]
        self.operands = (0.0,) * math.ceil(operands / FLOATS_PER_DOUBLE)
        self.computed = (0.0,) * math.ceil(results / FLOATS_PER_DOUBLE)

    def set_rate(self) -> None:
        """Set `every` from the sampling rate, where it is not given. Raises ValueError for rates that do not divide."""
        self._every = vars(self).get("_every", self.every)
        rate = self.rate or self.description.rate
        if not rate or self.diagram is None or self._every != 1:
            return
        ratio = self.diagram.rate / rate
        if ratio < 0.5 or abs(ratio - round(ratio)) > RATE_TOLERANCE * ratio:
            raise ValueError(
                f"the network has a sampling rate of {rate:g} Hz, and the diagram's rate, {self.diagram.rate:g} Hz, is "
                f"not a multiple of it: run the diagram at {max(1, round(ratio)) * rate:g} Hz, or pass rate=... or "
                "every=... to run the network at another rate than it was trained for"
            )
        self.every = round(ratio)
        self.dt = self.every / self.diagram.rate

    def output_range(self, *_: Any, **inputs: Interval) -> dict[str, Interval]:
        return {"age": Interval(0.0), "overruns": Interval(0.0)}


_RESERVED_NAMES = {name for name in dir(OnnxModel) if not name.startswith("_")} | set(OnnxModel.parameters)
