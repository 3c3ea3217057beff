"""Runs diagrams in virtual time, on the executor that robots run on, and returns every signal of every tick."""

import numpy as np

from blocks.recorders import CsvRecorder
from cext.bus.memory_bus import MemoryBus
from cext.memory.shared_state import RECORD_ROW, SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, Output, compile


class Recording:
    """What a run left behind: `recording["left/knee.position"]` is an array over the ticks; elements of vectors are
    `"imu.rate[1]"`.
    """

    def __init__(self, columns, rows, rate, outcome, statistics, buses):
        self.outcome, self.statistics, self.buses = outcome, statistics, buses
        self.time, self.tick = rows[:, 0] / rate, rows[:, 0]
        self.signals = {column.path: rows[:, 2 + column.index] for column in columns}

    def __getitem__(self, path):
        return self.signals[path]


def run(diagram, ticks, *, plant=None, substeps=1, fade=0.0, before=None):
    """Run a diagram for so many ticks. plant: another diagram at `substeps` times the rate; before(buses) may put
    frames on them first.
    """
    with diagram:
        if not any(isinstance(block, CsvRecorder) for block in diagram):
            CsvRecorder()
    schedule = compile(diagram)
    buses = {name: MemoryBus() for name in schedule.buses}
    control = Program(schedule, [buses[name].host for name in schedule.buses])
    models = None
    if plant is not None:
        plant_schedule = compile(plant)
        models = Program(plant_schedule, [buses[name].device for name in plant_schedule.buses])
    if before is not None:
        before(buses)
    width = 2 + len(schedule.columns)
    size = 8 * width  # bytes of a row
    shared = SharedState((size + 8 + 800) * (ticks + 1000) if schedule.buses else (size + 8) * (ticks + 10))
    outcome = Executor(control, schedule.rate, plant=models, substeps=substeps, shared=shared, virtual=True).run(
        ticks, fade=fade
    )
    records = shared.drain(1 << 30)
    assert shared.statistics()["dropped"] == 0
    rows = np.frombuffer(b"".join(payload for kind, payload in records if kind == RECORD_ROW)).reshape(-1, width)
    return Recording(schedule.sinks[0].columns, rows, schedule.rate, outcome, shared.statistics(), buses)


def player(values, unit="any", dtype=float):
    """A source that plays `values`, one a tick along the first axis, and then stays at the last."""
    values = np.asarray(values)
    rows = values.tolist() if values.ndim == 1 else values

    def step(self, tick):
        return rows[min(tick, len(rows) - 1)]

    body = {
        "__doc__": "Plays numbers.",
        "step": step,
        "y": Output(unit, "what is played", shape=values.shape[1:], dtype=dtype),
    }
    return type("Player", (Block,), body)()()


def by_hand(block, ticks, **inputs):
    """Step a block by hand, `inputs` being arrays over the ticks: a dict of arrays by output."""
    rows = []
    for tick in range(ticks):
        now = {name: values[tick] for name, values in inputs.items()}
        outputs = block.step(**now)
        if block.update_kernel is not None:
            block.update(**now)
        rows.append([outputs] if len(block.outputs) == 1 else outputs)
    return {name: np.array([row[i] for row in rows], dtype=float) for i, name in enumerate(block.outputs)}


def inside(make, *, rate=200, ticks=None, **inputs):
    """The same of the block that `make` makes, inside a running diagram."""
    with Diagram("running", rate=rate) as diagram:
        block = make()
        block(
            **{
                name: player(values, block.inputs[name].unit, block.inputs[name].dtype)
                for name, values in inputs.items()
            }
        )
    recording = run(diagram, ticks or len(next(iter(inputs.values()))))
    assert recording.outcome.status == "ok", recording.outcome

    def values(name):
        path = f"{block.path}.{name}"
        shape = recorded_shape(recording, path)
        return np.stack(
            [recording[path + "".join(f"[{i}]" for i in index)] for index in np.ndindex(shape)], axis=-1
        ).reshape(-1, *shape)

    return {name: values(name) for name in block.outputs}


def recorded_shape(recording, path):
    """Shape of a recorded signal, from the names of its columns."""
    indices = [name[len(path) :] for name in recording.signals if name == path or name.startswith(path + "[")]
    return tuple(
        1 + max(map(int, axis)) for axis in zip(*(index.strip("[]").split("][") for index in indices if index))
    )


def both_ways(make, *, rate=200, ticks=None, **inputs):
    """Outputs of `make()` stepped by hand, which must be bit for bit those of the same block inside a running
    diagram.
    """
    with Diagram("by hand", rate=rate):
        block = make()
    alone = by_hand(block, ticks or len(next(iter(inputs.values()))), **inputs)
    for name, values in inside(make, rate=rate, ticks=ticks, **inputs).items():
        assert np.array_equal(values, alone[name], equal_nan=True), name
    return alone
