"""Neural networks in ONNX form, run by ONNX Runtime."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from blocks._plumbing.network_files import reason, weights_of
from blocks._plumbing.network_ports import Description, describe, tensors
from blocks._plumbing.paths import file_param
from cext.kernels.networks.inference import tick
from cext.kernels.networks.model import FAILED, IN_USE, NO_THREAD, PROVIDERS, STALE, Model, runtime_version
from cext.kernels.networks.worker import Owner, Worker, delayed
from graph import Block, Input, Interval, Memory, Output, Param
from graph.diagram import current_scope

LAYOUTS = ("channels, time", "time, channels")
RATE_TOLERANCE = 1e-6  # relative difference of two equal rates
FLOATS_PER_DOUBLE = 2
BACKLOG = 1.0  # s of samples that wait for a streaming network in a worker before it begins again


class OnnxModel(Block):
    """Neural network in an ONNX file, with one input per channel and one output per result of the network.

    Names, units, normalisation and ranges of the ports are those in the file's metadata, or `channels` and `results`,
    as in `channels=({"name": "hip_angle", "unit": "rad", "mean": 0.2, "std": 0.4},)`. The network receives
    (x - mean) / std, and y = y_network · std + mean is clipped to `range`. NaN passes, and infinity becomes NaN.

    A network with one input, of shape (1, channels, samples), receives the last samples of each channel. A network with
    further inputs is a streaming one: it receives one sample, and its output NAME_next is the next value of its input
    NAME, which is 0 at the start; NaN can persist in it until the next reset. Until the network has received enough
    samples, its outputs have the value nearest to 0 in their range, and `valid` is false. Requires ONNX Runtime:
    `pip install 'tickwork[networks]'`.

    With `run="tick"` the inference is part of the tick. With `run="worker"` it runs in a native thread, and the results
    of the samples of a tick are the outputs `latency` later, in virtual time and in real time. A result that is not
    ready then never delays the tick: the last outputs hold, and `overruns` counts the tick. Outputs older than `stale`
    fade to the value nearest to 0 within as long again, or are a fault.
    """

    file = file_param("ONNX file")
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
    run = Param("tick", "1", "where the inference runs: in the tick, or in a worker thread", choices=("tick", "worker"))
    inference_time = Param(
        0.02,
        "s",
        "time that an inference in the tick may take before the watchdog of a rig regards the tick as hung",
        min=0.0,
        max=0.5,
        fixed=True,
        kernel=False,
    )
    latency = Param(
        0.0,
        "s",
        "delay of the results of a worker, rounded up to ticks of the block",
        min=0.0,
        fixed=True,
        kernel=False,
    )
    stale = Param(0.1, "s", "age of the outputs of a worker from which on they are stale", above=0.0, fixed=True)
    when_stale = Param(
        "fade", "1", "stale outputs fade to the value nearest to 0, or are a fault", choices=("fade", "fault")
    )
    provider = Param("cpu", "1", "execution provider of ONNX Runtime", choices=tuple(PROVIDERS))

    valid = Output("1", "true if the outputs follow from enough samples and are not stale", dtype=bool)
    age = Output("s", "time since the newest sample that the outputs are computed from")
    overruns = Output("1", "number of results that were not ready in time", dtype=int)
    model = Memory(0.0, "address of the loaded model")
    plan = Memory((1.0, 0.0, 1.0), "samples of the window, 1 if time is its first dimension, samples until valid")
    channel_scales = Memory(0.0, "mean and standard deviation of each channel")
    output_scales = Memory(0.0, "mean, standard deviation and range of each output")
    operands = Memory(0.0, "samples and states, in single precision")
    computed = Memory(0.0, "results and next states, in single precision")
    count = Memory(0.0, "samples received")
    ring = Memory(0.0, "address of the jobs of the worker")
    delay = Memory(0.0, "latency in ticks")
    stale_is_fault = Memory(0.0, "1 if stale outputs are a fault")

    kernel = tick
    scope_every: int | None = (
        None  # every n-th tick that the subsystem runs at; 0 if the block has `every`, or no diagram
    )

    def configure(self) -> None:
        try:
            self.loaded = loaded = self.load()
            self.description = describe(loaded.metadata, self.channels, self.results, reserved=_RESERVED_NAMES)
            inputs, outputs, samples = tensors(loaded, self.description, self.layout == LAYOUTS[1])
        except ValueError as error:
            raise ValueError(f"{self.file}: {error}") from None
        loaded.arrange(inputs, outputs, len(outputs) - len(inputs) + 1)
        self.streaming = len(inputs) > 1
        self.place(loaded, samples)
        self.set_rate()
        if self.run == "tick" and self.latency:
            raise ValueError('latency: an inference in the tick has none: pass run="worker", or omit it')
        if self.run == "worker" and not self.latency:
            raise ValueError('latency: run="worker" needs the delay of its results, as in latency=0.02')
        self.allowance = self.inference_time if self.run == "tick" else 0.0
        self.kernel, self.worker = tick.owned(loaded), None

    def load(self) -> Model:
        """Return the loaded model. Raises ValueError."""
        path = Path(self.file)
        content = path.read_bytes()
        try:
            return Model(content, self.provider, str(path.parent))
        except ValueError as error:
            raise ValueError(reason(path, content, str(error), runtime_version())) from None

    def files_of(self, name: str) -> list[Path]:
        """Return the ONNX file, and those with its weights."""
        path = Path(self.file)
        return [path, *(path.parent / other for other in weights_of(path.read_bytes()))]

    def prepare(self, dt: float) -> None:
        """Create the jobs of a worker for its latency. Raises ValueError for outputs that are always stale."""
        self.loaded.warm_up()
        if self.run == "tick":
            return
        steps = max(1, math.ceil(self.latency / dt - RATE_TOLERANCE))
        if self.stale < (steps + 1) * dt - RATE_TOLERANCE:
            raise ValueError(
                f"stale: {self.stale:g} s is shorter than the latency and one step of the block, {(steps + 1) * dt:g} "
                "s, so the outputs would always be stale"
            )
        backlog = math.ceil(BACKLOG / dt) if self.streaming else 1
        self.worker = Worker(self.loaded, steps + backlog)
        self.kernel = delayed.owned(Owner(self.worker))
        self.ring, self.delay = self.worker.address, float(steps * self.every)
        self.stale_is_fault = float(self.when_stale == "fault")

    def fault_text(self, status: int) -> str:
        """Return the text of a status of the kernels."""
        return {
            FAILED: f"the inference failed: {self.loaded.error}",
            STALE: f"its outputs are older than {self.stale:g} s",
            IN_USE: "two programs use its worker at the same time",
            NO_THREAD: "the thread of its worker cannot be started",
        }.get(status, "")

    def run_summary(self) -> str:
        """Return the durations of the inferences, and the number of late results."""
        times = self.inference_times
        if not times["count"]:
            return f"{self.path}: no inference"
        median, high, longest = (f"{1e3 * times[key]:.4g} ms" for key in ("p50", "p99", "max"))
        late = f"; {self.worker.late} results late" if self.worker else ""
        return f"{self.path}: {times['count']} inferences, {median} median, {high} p99, {longest} max{late}"

    @property
    def inference_times(self) -> dict[str, float]:
        """Percentiles of the durations of inferences since the start of the run, in s."""
        return self.loaded.times

    def place(self, loaded: Any, samples: int) -> None:
        """Set the ports and the memory of a loaded Model. samples : number of samples in the window"""
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
        needed = declared.receptive_field if self.streaming else samples
        self.model = loaded.address
        self.plan = (float(samples), float(self.layout == LAYOUTS[1]), float(needed))
        self.channel_scales = [x for each in declared.channels for x in (each.mean, each.std)]
        self.output_scales = [x for each in declared.results for x in (each.mean, each.std, *each.limits)]
        self.operands = (0.0,) * math.ceil(operands / FLOATS_PER_DOUBLE)
        self.computed = (0.0,) * math.ceil(results / FLOATS_PER_DOUBLE)

    def set_rate(self) -> None:
        """Set `every` from the sampling rate, where it is not given. Raises ValueError for rates that do not divide."""
        if self.scope_every is None:
            scope = current_scope()
            self.scope_every = 0 if scope is None or self.every != scope.every else scope.every
        rate = self.rate or self.description.rate
        if not rate or not self.scope_every:
            return
        present = self.diagram.rate / self.scope_every
        ratio = present / rate
        if ratio < 0.5 or abs(ratio - round(ratio)) > RATE_TOLERANCE * ratio:
            raise ValueError(
                f"the network has a sampling rate of {rate:g} Hz, and the rate of the diagram here, {present:g} Hz, is "
                f"not a multiple of it: use a rate such as {max(1, round(ratio)) * rate:g} Hz, or pass rate=... or "
                "every=... to run the network at another rate than it was trained for"
            )
        self.every = round(ratio) * self.scope_every
        self.dt = self.every / self.diagram.rate

    def output_range(self, *_: Any, **inputs: Interval) -> dict[str, Interval]:
        return {"age": Interval(0.0), "overruns": Interval(0.0)}


_RESERVED_NAMES = {name for name in dir(OnnxModel) if not name.startswith("_")} | set(OnnxModel.parameters)
