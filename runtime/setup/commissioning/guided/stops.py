"""Steps in which a drive holds a lever for a while: the ways to end a run, and the supply under load.

`stops` measures how soon the drive is without torque after each way to end a run. The run is a process of its own,
which `kill -9` can end. This one only listens to the bus: it measures the time from the signal to the first reply
without torque. What it cannot see, the operator says, and the record states which is which.
"""

from __future__ import annotations

import json
import math
import os
import select
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from graph import Param
from runtime.host.console.terminal import print_lines
from runtime.host.ending import Interrupted
from runtime.host.machine.probe import Machine
from runtime.robot.guardian.lock import BusLock, BusTaken
from runtime.robot.guardian.wires import SHARED, SocketCanWire
from runtime.robot.rig.tool_bus import ToolBus
from runtime.setup.commissioning.guided.bench import Bench, Given, Result, ask, number
from runtime.setup.commissioning.guided.driven import NO_LEVER, RATE, failed, lever_diagram, lever_of, run_on_rig
from runtime.setup.commissioning.guided.passive import supply_of
from runtime.setup.commissioning.guided.probes import Lever, LeverProbe

HELD_TIME, SETTLE_TIME = 20.0, 0.5  # s for which the run holds the lever, and after which it is held
WITHOUT_TORQUE = 0.3  # of the torque or current that held the lever, below which a drive counts as without torque
STOP_LIMIT = 0.2  # s from a signal to no torque, after which a run reports a drive that has not confirmed
LISTEN_TIME = 2.0  # s after a signal
GONE_TIME = 0.1  # s without a reply of a drive whose cable is out
POLL_TIME = 0.001  # s between two looks at the bus
SAG_LIMIT, OWN_TOLERANCE = 0.03, 0.05  # of the supply at rest: fall under load; difference of the drive's own reading
END_TIME = 60.0  # s for a connector to be put back, and a run to end
SIGNALS = {"ctrl_c": ("Ctrl-C", signal.SIGINT), "kill": ("kill -9", signal.SIGKILL)}
NOT_DONE = "not done"


class HoldProbe(LeverProbe):
    """LeverProbe that holds the lever for HELD_TIME in the positive direction, and reports when it does."""

    pipe = Param(-1, "1", "descriptor to which it writes once it holds the lever; -1: none")

    def configure(self) -> None:
        super().configure()
        self.ends[2] += HELD_TIME
        self.side_time += HELD_TIME

    def reset(self):
        super().reset()
        self.reported_hold, self.parent = False, os.getppid()

    def step(self, position, velocity, reported, t):
        if t - self.waited > self.ends[1] + SETTLE_TIME and not self.reported_hold:
            self.reported_hold = True
            if self.pipe >= 0:
                os.write(self.pipe, b"h")
        torque, current, over = super().step(position, velocity, reported, t)
        return torque, current, over or os.getppid() != self.parent


class Listener(ToolBus):
    """Bus that is only listened to, while a run controls it. `stops`: s, arrivals of frames that stop a drive"""

    def __init__(self, bench: Bench, block: Any) -> None:
        self.bus, self.sent, self.remarks, self.refused, self.errors = bench.rig.buses[block.bus], [], [], 0, 0
        self.wire = self.open(self.bus, Machine())
        if isinstance(self.wire, SocketCanWire):
            self.wire.virtual = True  # receives the frames of this machine, too
        self.stop_frames, self.stops = [(*frame[:2], bytes(frame[2])) for frame in block.disable_frames()], []
        self.read = bench.queries[block.path].read

    def loads(self) -> list[tuple[float, float]]:
        """Return (s, torque or current) of each reply of the drive that has arrived, after a short wait."""
        time.sleep(POLL_TIME)
        arrived = self.arrivals()
        self.stops += [at for frame, at in arrived if frame in self.stop_frames]
        found = [(at, answer) for frame, at in arrived if (answer := self.read(*frame)) is not None]
        values = [(at, each.current if each.torque is None else each.torque) for at, each in found]
        return [(at, value) for at, value in values if value is not None]

    def while_held(self, pipe: int) -> list[tuple[float, float]]:
        """Return the newest `loads` of a run once it holds the lever; [] for one that ended before."""
        while not select.select([pipe], [], [], 0.0)[0]:
            self.loads()
        seen, until = [], time.monotonic() + SETTLE_TIME * bool(os.read(pipe, 1))
        while time.monotonic() < until:
            seen += self.loads()
        return seen

    def __exit__(self, *exception: object) -> None:
        self.wire.close()


def stops(bench: Bench, block: Any, given: Given) -> Result:
    """Measure how soon a drive is without torque after each way to end a run, and ask for what cannot be measured."""
    lever = lever_of(block, given)
    if lever is None:
        return Result([NO_LEVER], done=False)
    bus = bench.rig.buses[block.bus]
    if bus.interface not in SHARED:
        return Result([f"{bus.interface} has one controller: a run on it cannot be listened to"], done=False)
    result = Result()
    for name, (text, kill) in SIGNALS.items():
        if not ask(f"{text}: press Enter, then Enter once more to arm (s: leave it out)"):
            time_after(bench, block, lever, result, name, text, kill)
        else:
            result.says.append(f"{text}: {NOT_DONE}")
    cable(bench, block, lever, result)
    said = ask(
        "Have you cut the power of the computer in an earlier run while this drive held the lever? Then: did the lever "
        "fall within a second? y or n (empty: not done)"
    )
    note_said(result, "the power of the computer cut", said, block)
    result.done = all(name in result.measured for name in SIGNALS)
    return result


def supply(bench: Bench, block: Any, given: Given) -> Result:
    """Compare the supply of a drive at rest with that while it holds a lever, which the operator reads from a meter."""
    lever = lever_of(block, given)
    if lever is None:
        return Result([NO_LEVER], done=False)
    rest = number("Connect a voltmeter at the plug of the drive. Its reading at rest in V (empty: no meter)")
    if rest is None:
        return Result([f"supply under load: {NOT_DONE}"], done=False)
    bench.take()
    own = supply_of(bench, block)
    diagram, probe = lever_diagram(block, lever, 0.0, HoldProbe)
    print_lines([f"  > Read the meter while the lever is held, for {HELD_TIME:.0f} s"])
    run = run_on_rig(bench, diagram, math.ceil(probe.side_time * RATE))
    if not probe.reported_hold:
        return failed(Result(), block, run)
    loaded = number("Reading while the lever was held in V (empty: not read)")
    return supply_under(rest, loaded, own, probe.wanted)


def supply_under(rest: float, loaded: float | None, own: float | None, torque: float) -> Result:
    """Compare readings of a meter. rest, loaded : V; own : V, that the drive reports at rest; torque : N·m"""
    if loaded is None:
        return Result([f"supply under load: {NOT_DONE}"], {"supply_at_rest": rest}, done=False)
    sag = (rest - loaded) / rest
    result = Result(measured={"supply_at_rest": rest, "supply_loaded": loaded, "sag": sag})
    result.says.append(
        f"operator says: {rest:g} V at rest, {loaded:g} V with {torque:.2g} N·m, which is {sag:.1%} less"
        + (f"; the drive reports {own:.1f} V at rest" if own is not None else "")
    )
    if sag > SAG_LIMIT:
        result.find(
            "sag of the supply",
            f"with {torque:.2g} N·m the supply falls from {rest:g} to {loaded:g} V, by {sag:.1%}: check fuse, plugs, "
            "cable and battery",
        )
    if own is not None and abs(own - rest) > OWN_TOLERANCE * rest:
        result.find("supply voltage", f"the drive reports {own:.1f} V, and the meter {rest:g} V: check plugs and cable")
    return result


def time_after(
    bench: Bench, block: Any, lever: Lever, result: Result, name: str, text: str, number: signal.Signals
) -> None:
    """Send a signal to a run that holds the lever, and note the time to no torque."""
    with held(bench, block, lever) as (process, pipe), Listener(bench, block) as listener:
        before = listener.while_held(pipe)
        load = sum(load for _, load in before[-20:]) / max(1, len(before[-20:]))
        if not load:
            result.says.append(f"{text}: {NOT_DONE}, the run ended before, or the drive reported no torque")
            return
        sent, after = time.monotonic(), []
        os.kill(process.pid, number)
        while time.monotonic() < sent + LISTEN_TIME and not after:
            after = [at for at, each in listener.loads() if at > sent and abs(each) < WITHOUT_TORQUE * abs(load)]
    if not after:
        result.find("no stop", f"{text}: the drive reported no reply without torque within {LISTEN_TIME:g} s")
        return
    result.measured[name] = after[0] - sent
    result.says.append(f"{text}: measured, without torque {result.measured[name] * 1e3:.0f} ms after the signal")
    if result.measured[name] > STOP_LIMIT:
        result.find("late stop", f"{text}: without torque only {result.measured[name]:.2f} s after the signal")


def cable(bench: Bench, block: Any, lever: Lever, result: Result) -> None:
    """Let the operator pull the connector of a drive that holds the lever, and note what each has seen."""
    text = "the CAN connector of the drive pulled"
    if ask("Cable out: press Enter, then Enter once more to arm (s: leave it out)"):
        result.says.append(f"{text}: {NOT_DONE}")
        return
    with held(bench, block, lever) as (process, pipe), Listener(bench, block) as listener:
        before = listener.while_held(pipe)
        stopped = None
        if before:
            print_lines(["", "  > Pull the CAN connector of the drive now"])
            last, until = before[-1][0], time.monotonic() + HELD_TIME
            while stopped is None and time.monotonic() < until:
                last = max([last, *(at for at, _ in listener.loads())])
                stopped = next((at for at in listener.stops if at > last + GONE_TIME), None)
            if stopped is not None:
                print_lines(["", "  > Watch the lever for a second, then put the connector back"])
                with suppress(subprocess.TimeoutExpired):
                    process.wait(END_TIME)
    if stopped is None:
        result.says.append(f"{text}: {NOT_DONE}, the drive responded until the run ended")
        return
    result.measured["cable"] = stopped - last
    result.says.append(
        f"{text}: measured, frames that stop the drive began {stopped - last:.2f} s after its last reply"
    )
    note_said(result, text, ask("Did the lever fall within a second? y or n (empty: not looked at)"), block)


def note_said(result: Result, text: str, said: str, block: Any) -> None:
    """Note what the operator has seen, in these words. said : y, n or ''"""
    if said.lower()[:1] not in ("y", "n"):
        result.says.append(f"{text}: {NOT_DONE}, or not looked at")
        return
    fell = said.lower()[:1] == "y"
    result.says.append(f"{text}: operator says: the lever {'fell' if fell else 'was held'}")
    if not fell and block.own_timeout is not None:
        result.find(
            "no time-out", f"{text}: the drive held the lever, and its time-out is set to {block.own_timeout:g} s"
        )


@contextmanager
def held(bench: Bench, block: Any, lever: Lever) -> Iterator[tuple[subprocess.Popen[bytes], int]]:
    """Yield (process of a run that holds the lever, pipe that is readable once it does or has ended).

    At the end the process has ended; a signal that it has not survived leaves the terminal as it was.
    """
    bench.release()
    given = [str(bench.file), str(bench.rig.path), list(bench.settings), block.path, lever.mass, lever.length]
    own, other = os.pipe()
    terminal = termios.tcgetattr(sys.stdin)
    process = subprocess.Popen(
        [sys.executable, "-c", f"from {__name__} import main; main()", json.dumps([*given, other])], pass_fds=[other]
    )
    os.close(other)
    try:
        yield process, own
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.wait()
        os.close(own)
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, terminal)
        await_release(bench.rig.buses[block.bus])


def await_release(bus: Any) -> None:
    """Wait until the guardian of a run that was killed has released a bus, at most END_TIME."""
    until = time.monotonic() + END_TIME
    while time.monotonic() < until:
        try:
            BusLock(bus.interface, bus.channel).close()
        except BusTaken:
            time.sleep(0.05)
        else:
            break


def main() -> None:
    """Hold a lever with one drive of a robot; its arguments are those of `held`, as JSON."""
    from runtime.robot.loading.file import load
    from runtime.robot.rig.file import read

    file, rig_path, settings, path, mass, length, pipe = json.loads(sys.argv[1])
    rig = read(rig_path)
    loaded, diagram = load(file, settings, rig)
    robot, probe = lever_diagram(diagram[path], Lever(mass, length), 0.0, HoldProbe, pipe=pipe)
    with suppress(Interrupted, KeyboardInterrupt):
        run = run_on_rig(Bench(loaded.path, rig, diagram), robot, math.ceil(probe.side_time * RATE))
        sys.exit(bool(run.outcome.faulted))
