"""Steps under torque: regular runs of one drive with a guardian, at most 5 % of the rated torque.

`diagram_of` connects a Probe to the drive, and `run_on_rig` runs it. The steps here need a lever of known mass, which
hangs from the output. The torque grows until the lever shows it, so that an unknown scale of the torque is found before
it is exceeded: torque at the joint = m g l sin(deflection).
"""

from __future__ import annotations

import math
import signal
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from blocks.limiters import Saturation
from blocks.safety import EmergencyStop
from graph import Device, Diagram
from graph.device import actuators_of
from runtime.host.console.terminal import print_lines, print_to_stderr
from runtime.host.ending import Interrupted, raise_if_ended_by_signal
from runtime.robot.loading.file import compile_diagram
from runtime.robot.rig.records import AGREES
from runtime.setup.commissioning.guided.bench import Bench, Given, Lost, Result, Unmeasured, confirmed, number
from runtime.setup.commissioning.guided.probes import GRAVITY, Friction, Lever, LeverProbe, friction_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from runtime.session.result import Result as RunResult

LIMIT_SHARE, USED_SHARE = 0.05, 0.035  # of the rated torque: limit of the runs, and torque that they aim at
COMMANDED = 0.97  # of the limit, largest command: its code is rounded
STEEPEST = 0.5  # of m g l, largest torque that the lever is to show: 30°
TORQUE_TOLERANCE = 0.12  # of the torque of the lever
SHOWN_SHARE, MOVED_SHARE = 0.25, 0.05  # of the torque, below which the drive gives none; of a lever that has moved
FRICTION_SEEN, FRICTION_HIDES = 0.1, 0.3  # of the commanded torque, from which friction counts; hides the torque
RATE = 200.0  # Hz
REPLY_TIMEOUT = 0.3  # s without a reply that ends a run; its torque is small, and computers on benches are slow
SET_TIMEOUT = 0.1  # s, that the operator sets in a drive that is not set over its bus
SILENCE = 0.4  # s without frames, for a drive without a declared time-out
LATE, LATER = 0.1, 0.5  # s beyond a declared time-out: a drive that acts by then is on time; that acts at all
FALL = 0.5  # periods of the lever / 2π, in which it shows that it has fallen
FALLEN_SHARE = 0.3  # of the deflection
SILENT = ("silent", "no answer")  # statuses of a run whose drive does not respond
STOPPED, FAULTED = "has stopped by itself", "device fault"  # a report and a status of a run
OF_COMPUTER = ("unguarded", "overrun", "hung", "suspended", "fenced", "exception")  # faults that no drive causes
OWN_FAULT = "the run ended for a reason of this computer, so nothing was measured: {}"
NO_LEVER = "without a lever nothing was measured"


def torque(bench: Bench, block: Any, given: Given) -> Result:
    """Compare direction and scale of the torque with a lever."""
    lever = lever_of(block, given)
    if lever is None:
        return Result([NO_LEVER], done=False)
    probe, run = drive(bench, block, lever)
    if not all(probe.sides().values()):
        return failed(Result(), block, run)
    return torque_of(block, lever, probe)


def torque_of(block: Any, lever: Lever, probe: LeverProbe) -> Result:
    """Compare direction and scale of the torque with what a lever has shown in a run."""
    result, sides = Result(), probe.sides()
    means = {name: [sum(row[i] for row in rows) / len(rows) for i in (1, 2, 3)] for name, rows in sides.items()}
    shown = {name: lever.torque * math.sin(angle) for name, (angle, _, _) in means.items()}
    commanded = (means["+"][1] - means["-"][1]) / 2.0
    ratio = (shown["+"] - shown["-"]) / 2.0 / commanded
    reported = (means["+"][2] - means["-"][2]) / 2.0 / commanded
    result.measured = {"ratio": ratio, "reported": reported, "commanded": commanded, "bias": shown["+"] + shown["-"]}
    result.says.append(
        f"{commanded:.3f} N·m commanded ({commanded / rated_of(block):.1%} of rated): the lever shows {ratio:.2f} "
        f"times that, the drive reports {reported:.2f} times"
    )
    friction = larger_of(lever, probe)
    if friction.held or friction.torque > FRICTION_SEEN * commanded:
        least = "at least " if friction.held else "about "
        result.measured["friction"] = friction.torque
        result.says.append(
            f"friction of {least}{friction.torque:.2g} N·m, {friction.torque / rated_of(block):.1%} of rated, holds it"
        )
    if ratio < -SHOWN_SHARE:
        result.find("sign of torque", "a positive torque turns the joint in the negative direction")
    elif ratio < (MOVED_SHARE if friction.held else SHOWN_SHARE):
        result.find(
            "no torque",
            f"the lever shows {ratio:.2f} times the commanded torque: the drive gives none, or the friction of the "
            "joint is larger. Turn it by hand to feel which",
        )
    elif hides(friction, ratio, commanded):
        result.done = False
        result.says.append("it hides the torque constant: not measured")
    elif abs(ratio - 1.0) > TORQUE_TOLERANCE:
        constant = getattr(block.spec, "torque_constant", None)
        own = f" of {constant:.3g} N·m/A, {constant * ratio:.3g} N·m/A by this lever" if constant else ""
        result.find(
            "torque constant",
            f"the joint receives {ratio:.2f} times the commanded torque: torque constant{own}, or encoded range of the "
            "torque",
        )
    return result


def larger_of(lever: Lever, probe: LeverProbe) -> Friction:
    """Return the Friction of the direction in which it was larger."""
    return max((friction_of(lever, fall) for fall in probe.falls.values()), key=lambda each: (each.held, each.torque))


def hides(friction: Friction, ratio: float, commanded: float) -> bool:
    """Return whether friction hides the torque of the drive: what the lever shows and how it falls contradict.

    ratio : of the torque; commanded : N·m
    """
    if not friction.held and friction.torque < FRICTION_SEEN * commanded:
        return False
    if friction.held or friction.torque > FRICTION_HIDES * commanded:
        return True
    agrees, follows = (abs(each - 1.0) <= TORQUE_TOLERANCE for each in (ratio, friction.scale))
    return not agrees and (follows or (friction.scale < 1.0) != (ratio < 1.0))


def friction_before(given: Given) -> Friction | None:
    """Return the Friction of the step `torque`, held unless its torque agrees; None if it has measured none."""
    step = given.steps.get("torque")
    if step is None or step.verdict != AGREES and "friction" not in step.measured:
        return None
    return Friction(step.measured.get("friction", 0.0), held=step.verdict != AGREES)


def silence(bench: Bench, block: Any, given: Given) -> Result:
    """Let the frames stop while the drive holds the lever, and see whether it stops by itself."""
    lever = lever_of(block, given)
    if lever is None:
        return Result([NO_LEVER], done=False)
    own, result = block.own_timeout, Result()
    friction = friction_before(given)
    if friction is not None and (friction.held or friction.torque > FRICTION_HIDES * wanted_of(block, lever)):
        return Result(["friction holds the lever also without torque: not measured"], done=False)
    measured = silence_of(bench, block, lever, own, result)
    if isinstance(measured, Result):
        return measured
    stopped, seconds, late = measured
    entry = getattr(block, "timeout_entry", ())
    if own is None and not stopped and entry:
        result.says.append("it has no time-out, or a longer one")
        print_lines([f"  {line}" for line in (f"{result.says[-1]}. To set {SET_TIMEOUT:g} s:", *entry)])
        if confirmed("Measure it again, with the time-out that you have set"):
            measured = silence_of(bench, block, lever, SET_TIMEOUT, result)
            if isinstance(measured, Result):
                return measured
            stopped, seconds, late = measured
            if not stopped:
                result.says.append("the setting had no effect")
    if own is None and stopped and "drive_timeout" in block.parameters:
        result.cures["drive_timeout"] = seconds if late or seconds == SILENCE else SET_TIMEOUT
        result.says.append(f"its time-out is {result.cures['drive_timeout']:g} s or less")
    elif own is None and not stopped:
        result.says.append("if computer and cable fail, it does not stop within this time")
    elif own is not None and not stopped:
        result.find(
            "no time-out",
            f"the drive held its torque for {seconds:.2f} s without frames, and its time-out is set to {own:g} s: rely "
            "on the guardian alone, or update the firmware",
        )
    elif late:
        result.find(
            "late time-out",
            f"the drive stopped by itself only within {seconds:.2f} s without frames, and its time-out is set to "
            f"{own:g} s: rely on the guardian alone, or update the firmware",
        )
    return result


def silence_of(
    bench: Bench, block: Any, lever: Lever, own: float | None, result: Result
) -> tuple[bool, float, bool] | Result:
    """Measure silences, and note them in a Result. Returns (whether the drive stopped by itself, s, whether late).

    own : time-out in s, None if unknown. A run that ended before is returned as a Result
    """
    fall = FALL / math.sqrt(GRAVITY / lever.length)
    silences = (SILENCE,) if own is None else (own + LATE + fall, 4.0 * own + LATER)
    stopped, seconds = False, 0.0
    for seconds in silences:
        probe, run = drive(bench, block, lever, seconds)
        ended = has_stopped(probe, run, lever)
        if ended is None:
            return failed(result, block, run)
        stopped = ended
        result.measured |= {"silence": seconds, "stopped": float(stopped)}
        result.says.append(
            f"without frames for {seconds:.2f} s, the drive {'has stopped by itself' if stopped else 'held its torque'}"
        )
        if stopped:
            break
    return stopped, seconds, seconds != silences[0]


def has_stopped(probe: LeverProbe, run: RunResult, lever: Lever) -> bool | None:
    """Return whether a drive has stopped by itself in a silence. None: the run ended before it was over."""
    if STOPPED in " ".join([*run.report, str(run.outcome.error or "")]):
        return True
    held = [row for row in probe.rows if row[0] == "held"]
    after = [row for row in probe.rows if row[0] == "after"]
    if after and run.outcome.status == FAULTED:
        return True  # the fault is the time-out, which such a drive reports
    if not after:
        return None
    angle, frequency = held[0][1], math.sqrt(GRAVITY / lever.length)
    return max(math.hypot(row[1] - angle, row[4] / frequency) for row in after) > FALLEN_SHARE * abs(angle)


def failed(result: Result, block: Any, run: RunResult) -> Result:
    """Return a result with the fault that ended a run; one of the computer is not a finding on the drive."""
    words = "; ".join(" ".join(line.split()) for line in run.report) or str(run.outcome.error or run.outcome.status)
    if run.outcome.status in OF_COMPUTER:
        return Result([OWN_FAULT.format(words)], done=False)
    if run.outcome.status in SILENT and run.outcome.culprit == "joint":
        raise Lost(words)
    name = "setting not kept" if "was written" in words else "fault of the run"
    result.find(name, f"{run.outcome.status} at {run.outcome.culprit or block.path}: {words}")
    return result


def raise_if_of_computer(run: RunResult) -> None:
    """Raise Unmeasured if the computer has ended a run."""
    if run.outcome.status in OF_COMPUTER:
        raise Unmeasured(OWN_FAULT.format(run.outcome.error or run.outcome.status))


def rated_of(block: Any) -> float:
    """Return the rated torque at the joint in N·m; the limit of the diagram where none is published."""
    rated = block.spec.rated
    return block.torque_limit if rated is None else rated * block.gear_ratio


def lever_of(block: Any, given: Given) -> Lever | None:
    """Return the Lever that the operator mounts, None without one; asked once for each device."""
    if given.lever is None:
        given.lever = asked_lever(block) or False
    return given.lever or None


def asked_lever(block: Any) -> Lever | None:
    """Ask for the Lever of a drive."""
    wanted = USED_SHARE * rated_of(block) / STEEPEST
    mass = number(
        f"Hang a lever with a weight from the output of {block.path}, free to swing; mass × length about "
        f"{wanted / GRAVITY:.2g} kg·m or more. Its mass in kg (empty: no lever)"
    )
    length = None if mass is None else number("Distance from the axis to the centre of the mass in m")
    if mass is None or length is None:
        return None
    print_to_stderr([f"  the lever gives {mass * GRAVITY * length:.2f} N·m when it is horizontal"])
    return Lever(mass, length)


def drive(bench: Bench, block: Any, lever: Lever, silence: float = 0.0) -> tuple[LeverProbe, RunResult]:
    """Run a LeverProbe on one drive, after the operator's Enter. Returns (LeverProbe, Result of the run)."""
    diagram, probe = lever_diagram(block, lever, silence)
    return probe, run_on_rig(bench, diagram, math.ceil(probe.duration * RATE))


def lever_diagram(
    block: Any, lever: Lever, silence: float, kind: type[LeverProbe] = LeverProbe, **own: Any
) -> tuple[Diagram, Any]:
    """Return (Diagram, its LeverProbe) of one drive. kind : of the probe; own : its other parameters"""
    limit, wanted = limit_of(block), wanted_of(block, lever)
    probe_of = partial(kind, wanted=wanted, lever=lever.torque, silence=silence, **own)
    return diagram_of(block, probe_of, limit, timeout=2.0 * silence)


def wanted_of(block: Any, lever: Lever) -> float:
    """Return the torque in N·m that a lever is to show."""
    return min(USED_SHARE / LIMIT_SHARE * limit_of(block), STEEPEST * lever.torque)


def run_on_rig(bench: Bench, diagram: Diagram, ticks: int) -> RunResult:
    """Run a diagram with a guardian, on the buses of its devices, and return its Result. Raises Interrupted."""
    from runtime.robot.rig.buses import RigBuses
    from runtime.robot.rig.overrides import override
    from runtime.session.prepare import Prepared
    from runtime.session.request import Request
    from runtime.session.session import Session

    bench.release()
    rig = replace(bench.rig, devices={})
    used = {block.bus for block in diagram if isinstance(block, Device)}
    override(replace(rig, buses={name: bus for name, bus in rig.buses.items() if name in used}), diagram)
    schedule = compile_diagram(bench.file, diagram)
    request = Request(bench.file, rig=bench.rig.path, no_record=True, bench=True, yes=not actuators_of(diagram))
    buses = RigBuses(rig, diagram, schedule.buses)
    run = Session(Prepared(request, diagram, schedule, None, buses, ticks), print_to_stderr).carry_out()
    bench.errors_in_runs.update({name: counts.get("errors", 0) for name, counts in buses.after.items()})
    if run.outcome.stopped:
        raise Interrupted(signal.SIGINT)
    raise_if_ended_by_signal(run.outcome)
    return run


def limit_of(block: Any) -> float:
    """Return the torque limit of the runs in N·m: LIMIT_SHARE of the rated torque, within the limit of the diagram."""
    return min(LIMIT_SHARE * rated_of(block), block.capped_limit)


def diagram_of(
    block: Any, probe_of: Callable[..., Any], limit: float, timeout: float = 0.0, **own: Any
) -> tuple[Diagram, Any]:
    """Return (Diagram, its Probe) of one drive with the parameters of the robot's.

    probe_of : returns a Probe; limit : N·m; timeout : s without a reply, REPLY_TIMEOUT at least; own : other parameters
    """
    own = {name: getattr(block, name) for name in block.parameters} | own
    timeout = max(own["timeout"], REPLY_TIMEOUT, timeout)
    changed = {"limit": limit, "zero_at_arming": False, "timeout": timeout}
    if own.get("restart_time"):
        longest = block.parameters["restart_time"].max
        changed["restart_time"] = min(
            timeout, longest or timeout
        )  # torque only: an angle that a restart has shifted moves nothing
    changed |= {name: block.parameters[name].default for name in ("reference", "known_pose") if name in own}
    if "mode" in own:
        changed["mode"] = block.parameters["mode"].default
    with Diagram("commission", rate=RATE) as diagram:
        joint = type(block)(**own | changed, name="joint")
        constant = {} if "torque_command" in joint.inputs else {"constant": joint.scales[2]}
        probe = probe_of(largest=COMMANDED * limit, name="probe", **constant)
        probe(joint.position, joint.velocity, joint.torque)
        sent = {name: getattr(joint, name) for name in ("torque_sent", "current_sent") if name in joint.outputs}
        probe(**{name: signal for name, signal in sent.items() if name in probe.inputs})
        EmergencyStop(name="over")(probe.over)
        if "torque_command" in joint.inputs:
            joint(torque_command=Saturation(lower=-limit, upper=limit)(probe.torque))
        else:
            most = joint.command_limits()["current_command"].high
            joint(current_command=Saturation(lower=-most, upper=most)(probe.current))
    return diagram, probe
