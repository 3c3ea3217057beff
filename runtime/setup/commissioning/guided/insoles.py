"""Step of a pressure insole: the operator steps on it, from heel to toes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from graph import Block, Diagram, Input
from runtime.setup.commissioning.guided.bench import Bench, Given, Result, ask
from runtime.setup.commissioning.guided.driven import raise_if_of_computer, run_on_rig
from runtime.setup.commissioning.guided.sensors import SENSOR_TIMEOUT, copied, jumps_of

STEP_TIME, FIRST_TIME = 8.0, 0.5  # s of the reading, and of its beginning, in which the foot is in the air
LOADED = 150.0  # N, by which the force rises when the wearer steps on an insole
IN_THE_AIR = 80.0  # N, of a shoe about a foot in the air
HEAVIEST, LIGHTEST = 3000.0, 15.0  # N: above, no wearer is so heavy; below, a foot was only lifted
LOST_SHARE, CORRUPT_SHARE, DEAD_SHARE = 0.05, 0.02, 0.02  # of the frames, and of the cells
ROLLED = 0.03  # m, by which the centre of pressure moves from heel to toes
PART = 0.2  # of the loaded samples, at the beginning and at the end


@dataclass(frozen=True)
class Loading:
    """Samples of an insole, one a tick. force : (n,) N; forward : (n,) m, centre of pressure from the heel

    lost, corrupt : shares of the frames; dead : share of the cells
    """

    force: np.ndarray
    forward: np.ndarray
    lost: float
    corrupt: float
    dead: float
    first: int  # samples in the air
    drift: np.ndarray | None = None  # (n,), relative slowness of the sender's clock; None without one

    @property
    def rise(self) -> float:
        """Force in N by which it rises from the beginning."""
        return float(self.force.max() - np.median(self.force[: self.first]))


class InsoleSamples(Block):
    """Keeps the samples of an insole."""

    force = Input("N", "total force")
    centre = Input("m", "centre of pressure", shape=(2,))
    received = Input("1", "number of frames")
    lost = Input("1", "number of missing frames")
    corrupt = Input("1", "number of wrong frames")
    dead = Input("1", "number of dead cells")
    clock_drift = Input("1", "relative slowness of the sender's clock")

    def reset(self):
        self.rows = []

    def step(self, force, centre, received, lost, corrupt, dead, clock_drift):
        self.rows.append((force, centre[0], received, lost, corrupt, dead, clock_drift))


def read(bench: Bench, seconds: float) -> dict[str, Loading]:
    """Return {path: Loading} of every insole that sends frames."""
    insoles = list(bench.insoles)
    while insoles:
        with Diagram("insoles", rate=bench.diagram.rate) as diagram:
            kept = {}
            for block in insoles:
                sensor = copied(block, timeout=SENSOR_TIMEOUT)
                samples = kept[block.path] = InsoleSamples(name=f"samples_of_{block.path.replace('/', '_')}")
                samples(**{name: getattr(sensor, name) for name in InsoleSamples.inputs})
        run = run_on_rig(bench, diagram, math.ceil(seconds * diagram.rate))
        raise_if_of_computer(run)
        if not (outcome := run.outcome).faulted:
            first = math.ceil(FIRST_TIME * diagram.rate)
            return {block.path: loading_of(kept[block.path].rows, block, first) for block in insoles}
        missing = {*outcome.unanswered} or {outcome.culprit or insoles[0].path}
        insoles = [block for block in insoles if block.path not in missing]
    return {}


def loading_of(rows: list[tuple[float, ...]], block: Any, first: int) -> Loading:
    """Return the Loading of the rows of InsoleSamples of an Insole. first : samples in the air"""
    force, forward, received, lost, corrupt, dead, drift = np.array(rows).T
    new, gone, wrong = (float(each[-1] - each[0]) for each in (received, lost, corrupt))
    frames = max(1.0, new + gone + wrong)
    cells = block.rows * block.columns
    stamped = drift if block.clock else None
    return Loading(force, forward, gone / frames, wrong / frames, float(dead[-1]) / cells, first, stamped)


def load(bench: Bench, block: Any, given: Given) -> Result:
    """Compare the insoles while the operator steps on one of them."""
    ask(
        f"Lift the foot of {block.path}, then press Enter. Once it is running, wait a second, step on it with your "
        f"whole weight, roll from heel to toes within 4 s, and lift it again"
    )
    return load_of(block.path, read(bench, STEP_TIME))


def load_of(path: str, loadings: dict[str, Loading]) -> Result:
    """Compare the Loadings of all insoles while one of them was stepped on."""
    result = Result()
    if path not in loadings:
        result.find("silent", "the insole sends no frames: check its program, address and battery")
        return result
    own, rises = loadings[path], {name: loading.rise for name, loading in loadings.items()}
    unloaded = float(np.median(own.force[: own.first]))
    result.measured = {"rise": own.rise, "in_the_air": unloaded, "lost": own.lost, "dead": own.dead}
    result.says.append(
        f"{unloaded:.0f} N in the air, {own.rise:.0f} N more on the ground; {own.lost:.1%} of frames lost"
    )
    if own.corrupt > CORRUPT_SHARE:
        result.find("corrupt frames", f"{own.corrupt:.0%} of the frames have a wrong checksum or size")
    elif own.lost > LOST_SHARE:
        result.find("drop-outs", f"{own.lost:.0%} of the frames did not arrive: check the network and the battery")
    if jumps := jumps_of(own.drift):
        result.find("time stamps", f"{jumps}: check the clock of its sender")
    if own.dead > DEAD_SHARE:
        result.find("dead cells", f"{own.dead:.0%} of the cells are missing or broken: replace the insole")
    others = [name for name, rise in rises.items() if name != path and rise > LOADED]
    if own.rise < LOADED:
        if others:
            result.find("exchanged", f"{' and '.join(others)} was loaded instead: exchange sides or addresses")
        elif not result.findings:
            rise = f", {own.rise:.0f} N at most: check its scale" if own.rise > LIGHTEST else ""
            return Result([f"no insole was loaded{rise}. Repeat with --again load"], result.measured, done=False)
        return result
    if own.rise > HEAVIEST:
        result.find(
            "scale of the insole",
            f"it reads {own.rise:.0f} N more under a foot: check length, breadth, rows and the unit of its sender",
        )
    if unloaded > IN_THE_AIR:
        result.find(
            "offset of the insole", f"it reads {unloaded:.0f} N in the air: loosen the shoe, or tare the insole"
        )
    where = own.forward[(own.force > unloaded + 0.5 * own.rise) & np.isfinite(own.forward)]
    part = max(1, round(PART * len(where)))
    rolled = float(where[-part:].mean() - where[:part].mean()) if len(where) else 0.0
    result.measured["rolled"] = rolled
    result.says.append(f"the centre of pressure moved by {rolled:.3f} m towards the toes")
    if rolled < -ROLLED:
        result.find("reversed", "the centre of pressure moved from toes to heel: the rows of the insole are reversed")
    return result
