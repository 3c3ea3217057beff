"""Pictures of the responses of blocks: over time, over the input, and over frequency."""

import math

import matplotlib
import numpy as np

import runtime
from blocks.discrete import UnitDelay
from blocks.sources import GaussianNoise, StepSource
from graph import Diagram, units
from runtime.record.analysis import picture
from tests.docs.block_examples import made, parameters, run
from tests.docs.shown import RATE

FREQUENCIES = np.geomspace(0.5, 95.0, 2000)  # Hz, closer than the width of a notch
FAINTEST = 1e-4  # share of the largest gain below which a frequency response is not drawn
COLOURS = (*picture.COLOURS, picture.INK)


def frequency_response(shown):
    """Return (gain, phase in rad) over FREQUENCIES of a block with one input and one output, None if it is nonlinear.

    The response to the sum of two noises is compared with the sum of their responses, and the transform of one
    output divided by that of its input.
    """
    if shown.style != "step" or len(shown.inputs) != 1 or len(made(shown.kind).outputs) != 1:
        return None
    a, b, both = (_noise(shown, weights) for weights in ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0)))
    if not np.allclose(a + b, both, rtol=1e-6, atol=1e-9 * np.abs(both).max()) or np.ptp(both) == 0.0:
        return None
    impulse, later = _impulse(shown, 5.0), _impulse(shown, 7.0)
    if not np.allclose(impulse, later, rtol=1e-6, atol=1e-9) or np.abs(impulse[-100:]).max() > 1e-3 * impulse.max():
        return None  # of a block that changes with time, or that does not forget
    times = np.arange(len(impulse)) / RATE
    response = np.array([np.sum(impulse * np.exp(-2j * math.pi * f * times)) for f in FREQUENCIES])
    gain, phase = np.abs(response), np.unwrap(np.angle(response))
    return None if np.ptp(gain) < 1e-6 and np.ptp(phase) < 1e-6 else (gain, phase)


def _noise(shown, weights):
    with Diagram("noise", rate=RATE) as diagram:
        noise = [weight * GaussianNoise(seed=seed)() for seed, weight in enumerate(weights)]
        _block(shown)(noise[0] + noise[1])
    return _output(diagram, 2.0)


def _impulse(shown, time):
    """Return the response to one sample of 1 at a time in s, from then on for 10 s."""
    with Diagram("impulse", rate=RATE) as diagram:
        step = StepSource(time=time)()
        _block(shown)(step - UnitDelay()(step))
    return _output(diagram, time + 10.0)[round(time * RATE) :]


def _block(shown):
    return shown.kind(**parameters(shown.kind), name="block")


def _output(diagram, seconds):
    trial = runtime.run(diagram, seconds)
    [path] = [path for path in trial.signals if path.startswith("block.")]
    return np.asarray(trial[path], float)


def draw(shown, target):
    """Write the response of an example as SVG. Returns its description, "" if it has none or if it is constant."""
    if shown.style == "none":
        return ""
    trial, inputs = run(shown)
    outputs = [path for path in trial.signals if path.startswith("block.") and np.ptp(np.asarray(trial[path], float))]
    if not outputs:
        return ""
    if shown.style == "curve":
        return _draw_curve(trial, inputs, outputs, target)
    return _draw_times(shown, trial, inputs, outputs, target)


def _axes(rows, height=1.7):
    figure = picture.figure(7.0, 0.6 + height * rows)
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    for each in axes:
        picture.frame(each)
    return figure, axes


def _save(figure, target):
    figure.align_ylabels()
    for each in figure.axes:
        each.margins(x=0.0)
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": target.name}):
        figure.savefig(target, format="svg", metadata={"Date": None})


def _label(name, unit):
    return name if unit in (units.ONE, units.ANY, "", None) else f"{name} [{unit}]"


def _draw_curve(trial, inputs, outputs, target):
    [[name, source]] = inputs.items()
    figure, axes = _axes(len(outputs), 2.4)
    for each, path in zip(axes, outputs):
        each.plot(np.asarray(trial[source], float), np.asarray(trial[path], float), color=picture.BLUE)
        each.set_ylabel(_label(path.rpartition(".")[2], trial.unit(path)))
    axes[-1].set_xlabel(_label(name, trial.unit(source)))
    _save(figure, target)
    return "Output over input"


def _draw_times(shown, trial, inputs, outputs, target):
    if shown.style == "time" and len(outputs) > 8:  # a Walker
        outputs = [path for path in outputs if path.startswith("block.left") and path.endswith(("_angle", "_phase"))]
    signals = [(name, path, True) for name, path in inputs.items()]
    signals += [(path.rpartition(".")[2], path, False) for path in outputs]
    panels = {}
    for name, path, given in signals:
        values = np.asarray(trial[path])
        key = (given, trial.unit(path), "" if values.ndim == 1 and values.dtype.kind != "i" else name)
        panels.setdefault(key, []).append((name, path))
    follows = shown.style == "walk" and not shown.motion
    start = shown.duration / 2 if follows else 0.0  # by when blocks follow a steady gait
    panels = {key: entries for key, entries in panels.items() if _curves(trial, entries) <= len(COLOURS)}
    figure, axes = _axes(min(len(panels), 7))
    for each, ((given, unit, _), entries) in zip(axes, panels.items()):
        count = 0
        for name, path in entries:
            values = np.asarray(trial[path], float).reshape(len(trial[path]), -1)
            times = np.asarray(trial.time_of(path))
            drawn = times >= start
            for part, value in enumerate(values.T):
                label = f"{name}[{part}]" if values.shape[1] > 1 else name
                each.plot(times[drawn], value[drawn], color=COLOURS[count % len(COLOURS)], label=label)
                count += 1
        if count == 1:
            each.lines[0].set_color(picture.GREY if given else picture.BLUE)
        elif count <= len(COLOURS):
            each.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
        sign = "" if unit in (units.ONE, units.ANY, "", None) else f" [{unit}]"
        each.set_ylabel((entries[0][0] if count == 1 else "inputs" if given else "outputs") + sign)
    axes[-1].set_xlabel("time [s]")
    _save(figure, target)
    return {"step": "Step response", "walk": "Response to a walking adult", "time": "Output over time"}.get(
        shown.style, "Response to waves"
    )


def _curves(trial, entries):
    return sum(trial[path].size // len(trial[path]) for _, path in entries)


def draw_frequency_response(shown, target):
    """Write the frequency response of a linear block as SVG. Returns whether there is one."""
    found = frequency_response(shown)
    if found is None:
        return False
    figure, axes = _axes(2)
    gain, phase = np.maximum(found[0], FAINTEST * found[0].max()), found[1]
    axes[0].loglog(FREQUENCIES, gain, color=picture.BLUE)
    axes[0].set_ylim(min(gain.min(), gain.max() / 12) / 1.1, gain.max() * 1.1)  # at least a decade: no rounding errors
    axes[0].set_ylabel("gain")
    axes[1].semilogx(FREQUENCIES, np.degrees(phase), color=picture.BLUE)
    axes[1].set_ylabel("phase [deg]")
    axes[1].set_xlabel("frequency [Hz]")
    _save(figure, target)
    return True
