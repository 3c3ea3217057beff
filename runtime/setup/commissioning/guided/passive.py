"""Steps in which nothing moves: identity, bus, replies and errors. The drives receive only their disable frame."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any

from cext.safety.thresholds import ZERO_LIMIT
from runtime.host.console.terminal import print_lines
from runtime.setup.commissioning.guided.bench import NOISE, Bench, Given, Lost, Result, Sample, confirmed

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from runtime.robot.rig.battery import Battery

REPLIES = 150  # queries
QUERY_TIME = 0.4  # s of queries to all drives of a bus
REPLY_TIMEOUT = 0.1  # s
STOPS = 3  # disables of which a drive answers one
ALONE, ALONE_TIME = 5, 0.02  # queries of one drive, and s before and after each
REPORTS_TIME = 0.5  # s of reports that are counted
REPORTS = 4  # fewest reports in that time of a drive that reports by itself
REPORTS_SHARE = 0.7  # of the declared rate, below which the reports are too slow
LOST_SHARE = 0.02  # of the replies, above which a bus has a fault
MORE_REPORTS = 1.5  # times the declared rate, above which the reports are too many
COLDEST, HOTTEST = -15.0, 80.0  # °C of a drive that has rested in a room
REST_SPEED = 0.1  # rad/s, mean velocity of a joint that rests
REST_TORQUE = 0.025  # of the rated torque, mean torque of a drive that is disabled
SLOW_SHARE = 0.5  # of the period, median reply time above which a drive is slow
SUPPLY_TOLERANCE, EMPTY_SHARE = 0.03, 0.12  # of the voltage of a full battery, and of the nominal one
ZERO_SILENCE = 0.1  # s without a reply after its zero was set, above which a drive counts as silent
ZERO_TIME = 2.5  # s of queries after that frame
ZEROED = 0.05  # rad, position after its zero was set


def identity(bench: Bench, block: Any, given: Given) -> Result:
    """Compare what responds at the drive's id with its block: protocol, number of drives, firmware, serial number."""
    report, result = bench.report(block.bus), Result()
    here = [drive for drive in report.drives if drive.can_id == block.can_id]
    if report.commanded:
        result.find("another controller", report.remarks[-1])
        return result
    twins = [remark for drive in here for remark in drive.remarks if "have id" in remark]
    on_bus = [each for each in bench.drives if each.bus == block.bus]
    lost = [path for path, samples in bench.for_seconds(QUERY_TIME, on_bus).items() if not samples]
    others = two_replies(bench, block)
    if twins:
        result.find("two drives with one id", twins[0])
    elif others and not (block.path in lost and here):
        result.find(
            "two drives with one id",
            f"each query of id {block.can_id} has {'a' if block.path in lost else 'another'} reply {others}: "
            "disconnect all drives but one, and set its ids",
        )
    elif block.path in lost and here:
        found = " and ".join(dict.fromkeys(drive.family for drive in here))
        result.find(
            "protocol",
            f"id {block.can_id} responds as {found}, and the diagram has a {type(block).__name__}: change the "
            "protocol of the drive or the block",
        )
    elif block.path in lost:
        ids = ", ".join(str(drive.can_id) for drive in report.drives) or "none"
        result.find("silent", f"no drive responds as id {block.can_id} on {block.bus}; ids that respond: {ids}")
        if 1 < len(lost) < len(on_bus):
            result.find(
                "part of a bus",
                f"{', '.join(lost)} are silent, and the other drives of {block.bus} respond: check the cable and the "
                "supply between the two groups",
            )
    elif not twins and not confirms_stop(bench, block):
        result.find(
            "protocol",
            f"the drive replies, but not to the disable of a {type(block).__name__}: it is another board, and would "
            "not confirm the safe stop",
        )
    own = [] if block.path in lost else here
    for drive in own:
        result.says += [f"{drive.family}, firmware {drive.firmware or 'not reported'}"] + drive.notes
        for remark in drive.remarks:
            if remark not in twins:
                result.find("identity", remark)
        reply = drive.settings.get("reply", getattr(block, "reply", None))
        if reply != getattr(block, "reply", None):
            result.find("length of replies", f"the drive replies with {reply} bytes", reply=reply)
    return result


def two_replies(bench: Bench, block: Any) -> str:
    """Return which replies follow each query of one drive besides its own, as text; "" for none."""
    tool, query = bench.buses[block.bus], bench.queries[block.path]
    if query.frame is None:
        return ""
    before, after = [], []
    for _ in range(ALONE):
        before += tool.listen(ALONE_TIME)
        tool.send(query.frame, "disable")
        after.append({key_of(frame) for frame in tool.listen(ALONE_TIME) if not query.read(*frame)})
    others = set.intersection(*after) - {key_of(frame) for frame in before}
    return ", ".join(
        f"{identifier:08X}" if extended else f"{identifier:03X} of id {first}" for identifier, extended, first in others
    )


def key_of(frame: tuple[int, bool, bytes]) -> tuple[int, bool, int]:
    """Return (identifier, is extended, first byte of a standard frame, which is the id in replies of MIT mode)."""
    identifier, extended, data = frame
    return identifier, extended, data[0] if data and not extended else -1


def after_silence(bench: Bench, block: Any, observed: str, repeat: Callable[[], Result] | None = None) -> Result:
    """Compare what responds now at the id of a drive that has stopped responding.

    observed : as text; repeat : carries the step out once more, if the drive responds again as it should
    """
    bench.reports.pop(block.bus, None)
    result = identity(bench, block, Given(0.0))
    result.says.insert(0, observed)
    if not result.findings and repeat is not None:
        print_lines([f"  {observed}", "  it responds again, so the step is repeated"])
        result = repeat()
        result.says.insert(0, f"repeated after: {observed}")
    elif not result.findings:
        result.find("silent", f"{observed}, and responds again: check its plug, cable and supply")
    return result


def confirms_stop(bench: Bench, block: Any) -> bool:
    """Return whether a drive answers its disable as its block requires, or reports an error instead."""
    stop, tool, read = block.stop_reply(), bench.buses[block.bus], bench.queries[block.path].read
    if stop is None or not stop.echo:
        return True
    for _ in range(STOPS):
        for frame in block.disable_frames():
            tool.send(frame, "disable")
        received = tool.listen(REPLY_TIMEOUT)
        if any(read(*frame) and frame[2][stop.echo[0]] for frame in received):
            return True
    return False


def bus(bench: Bench, block: Any, given: Given) -> Result:
    """Count errors of the bus while it is idle and at the rate of the diagram, and measure the time to a reply."""
    bench.take()
    tool, query, result = bench.buses[block.bus], bench.queries[block.path], Result()
    tool.listen(REPLY_TIMEOUT)  # replies to earlier queries
    before, corrupt = tool.errors, tool.wire.counts.get("corrupt", 0)
    reports = [frame for frame in tool.listen(REPORTS_TIME) if query.read(*frame)]
    idle = tool.errors - before
    times, lost = [], 0
    for _ in range(REPLIES):
        due = time.monotonic() + bench.period
        tool.take()
        began = time.monotonic()
        tool.send(query.frame, "disable")
        reply = tool.listen(REPLY_TIMEOUT, lambda frames: any(query.read(*frame) for frame in frames))
        if any(query.read(*frame) for frame in reply):
            times.append(time.monotonic() - began)
        else:
            lost += 1
            if lost > REPLIES * 0.2 and not times:
                raise Lost(f"none of {lost} queries had a reply")
        time.sleep(max(0.0, due - time.monotonic()))
    loaded = tool.errors - before - idle
    corrupt = tool.wire.counts.get("corrupt", 0) - corrupt
    result.measured = {"errors_idle": idle, "errors_loaded": loaded, "lost": lost, "queries": len(times) + lost}
    if times:
        times.sort()
        p50, p99 = times[len(times) // 2], times[min(len(times) - 1, int(0.99 * len(times)))]
        result.measured |= {"reply_p50": p50, "reply_p99": p99}
        result.says.append(
            f"{len(times)} of {len(times) + lost} replies, after {p50 * 1e3:.2f} ms (median) and {p99 * 1e3:.2f} ms "
            f"(99 %); errors of the bus: {idle} idle, {loaded} at {1.0 / bench.period:g} Hz"
        )
        transit = max(getattr(block, "max_transit", bench.period), bench.period)
        if len(reports) < REPORTS and p50 > max(SLOW_SHARE * bench.period, transit):
            result.find(
                "slow replies",
                f"half of the replies take more than {p50 * 1e3:.1f} ms, a tick {bench.period * 1e3:g} ms: update the "
                f"firmware, or reduce the rate to {0.3 / p50:.0f} Hz",
            )
    compare_reports(result, block, len(reports))
    if lost > LOST_SHARE * REPLIES:
        result.find(
            "lost replies",
            f"{lost} of {len(times) + lost} queries had no reply: check the termination (60 Ω between CAN_H and CAN_L "
            "without supply), the plugs and the cable",
        )
    if idle + loaded or corrupt:
        result.find(
            "bus errors",
            f"{idle} error frames while idle, {loaded} at {1.0 / bench.period:g} Hz, {corrupt} corrupt frames: check "
            "termination, shield and a common ground",
        )
    return result


def compare_reports(result: Result, block: Any, reports: int) -> None:
    """Compare the rate of the reports that a drive has sent by itself with its block's. reports : in REPORTS_TIME"""
    declared = getattr(block, "report_rate", None)
    rate = reports / REPORTS_TIME
    if declared is None or (declared == 0.0 and reports < REPORTS):
        return
    result.measured["report_rate"] = rate
    if declared == 0.0 or not REPORTS_SHARE * declared <= rate <= MORE_REPORTS * declared:
        twice = ", or disconnect a second drive with this id" if rate > declared > 0.0 else ""
        result.find(
            "report rate",
            f"the drive sends {rate:.0f} reports a second by itself, and report_rate is {declared:g} Hz: set the rate "
            f"with the vendor's tool, or declare it{twice}",
            **({"report_rate": float(round(rate, -1 if rate > 50.0 else 0))} if reports >= REPORTS else {}),
        )


def state(bench: Bench, block: Any, given: Given) -> Result:
    """Read error, temperature and noise of the encoder of a drive at rest."""
    samples, result = bench.at_rest(block), Result()
    last = samples[-1].answer
    spread = noise_of(samples)
    result.measured = {"noise": spread}
    if last.temperature is not None:
        result.measured["temperature"] = last.temperature
        result.says.append(f"{last.temperature:.0f} °C")
    result.says.append(f"position within {spread * 1e3:.1f} mrad at rest")
    if spread > NOISE:
        result.find(
            "noisy position",
            f"the reading moves by {spread:.3f} rad while the joint rests: check that it is still, then the ground, "
            "the shield and the magnet of the encoder",
        )
    faults = list(dict.fromkeys(sample.answer.fault for sample in samples if sample.answer.fault))
    for fault in faults:
        contradicted = block.other_errors(fault, last.temperature) if hasattr(block, "other_errors") else ""
        if contradicted:
            result.find(
                "error semantics",
                f"the drive reports {fault!r} at {last.temperature:.0f} °C: the error byte of this firmware is a "
                f"{contradicted}",
                errors=contradicted,
            )
        else:
            result.find("fault", f"the drive reports: {fault}")
    if not result.findings:
        compare_rest(result, block, samples)
    if (voltage := last.voltage or supply_of(bench, block)) is not None:
        compare_supply(result, block, bench.rig.battery, voltage)
    return result


def compare_rest(result: Result, block: Any, samples: Sequence[Sample]) -> None:
    """Name a temperature, velocity or torque that a drive which rests cannot have, and one that is still enabled."""
    last = samples[-1].answer
    if last.temperature is not None and not COLDEST <= last.temperature <= HOTTEST:
        result.find(
            "temperature",
            f"the drive reports {last.temperature:.0f} °C at rest and no error: let it cool down, or its sensor, its "
            "wire or the layout of the reply is another",
        )
    velocity = sum(sample.velocity for sample in samples) / len(samples)
    moved = samples[-1].position - samples[0].position
    if abs(velocity) > REST_SPEED and abs(velocity) * (samples[-1].time - samples[0].time) > 2.0 * abs(moved):
        result.measured["velocity"] = velocity
        result.find(
            "velocity at rest", f"the drive reports {velocity:.2f} rad/s while its position moves by {moved:.3f} rad"
        )
    torques = [sample.answer.torque for sample in samples if sample.answer.torque is not None]
    torque, rated = sum(torques) / max(1, len(torques)), block.spec.rated
    if rated is not None and abs(torque) > REST_TORQUE * rated:
        result.measured["torque"] = torque
        result.find(
            "torque at rest",
            f"the drive reports {torque:.2f} N·m although it is disabled: another controller, an offset of its "
            "current, or firmware that ignores the disable",
        )
    if all(sample.answer.enabled for sample in samples):
        result.find("not disabled", "the drive reports that it is enabled after each disable")


def supply_of(bench: Bench, block: Any) -> float | None:
    """Return the supply voltage that a drive reports, V; None if it reports none."""
    if not hasattr(block, "read_parameter"):
        return None
    voltage = bench.buses[block.bus].converse(block.read_parameter("VBUS"))
    return voltage if voltage and math.isfinite(voltage) else None  # a drive that replies has a supply


def compare_supply(result: Result, block: Any, battery: Battery | None, voltage: float) -> None:
    """Compare the supply voltage of a drive at rest with the range of its model and with the battery of the rig."""
    result.measured["supply"] = voltage
    result.says.append(f"supply {voltage:.1f} V at rest")
    low, high = block.spec.supply or (0.0, math.inf)
    if not low <= voltage <= high:
        result.find("supply voltage", f"the drive reports {voltage:.1f} V, and its model needs {low:g} to {high:g} V")
    elif battery is not None and voltage > battery.full_voltage * (1.0 + SUPPLY_TOLERANCE):
        result.find(
            "supply voltage",
            f"the drive reports {voltage:.1f} V, and [battery] is full at {battery.full_voltage:g} V: correct the rig",
        )
    elif battery is not None and voltage < battery.voltage * (1.0 - EMPTY_SHARE):
        result.find(
            "supply voltage",
            f"the drive reports {voltage:.1f} V without load, and [battery] has {battery.voltage:g} V: charge it, or "
            "check fuse, plugs and cable",
        )


def noise_of(samples: Sequence[Sample]) -> float:
    """Return the range of positions in rad at rest, without the largest and smallest hundredth."""
    positions = sorted(sample.position for sample in samples)
    edge = len(positions) // 100
    return positions[-1 - edge] - positions[edge]


def zero(bench: Bench, block: Any, given: Given) -> Result:
    """Set the zero of a drive that sets it at every arming, and measure for how long it is silent."""
    frame = block.set_zero_frame() if getattr(block, "zero_at_arming", False) else None
    if frame is None:
        return Result(["its zero is not set at arming"], done=False)
    if not confirmed("make the present position the zero of the drive, as every arming does"):
        return Result(["the zero was not set"], done=False)
    bench.at_rest(block)
    bench.buses[block.bus].send(frame, "set zero")
    began = time.monotonic()
    samples = bench.for_seconds(ZERO_TIME, [block])[block.path]
    replies = [sample.time - began for sample in samples]
    gaps = [after - before for before, after in zip([0.0, *replies], [*replies, ZERO_TIME])]
    silence, result = max(gaps), Result()
    result.measured = {"silence": silence}
    result.says.append(f"longest silence after its zero was set: {silence:.2f} s")
    if silence > ZERO_SILENCE:
        result.find(
            "silent after zero",
            f"the drive does not reply for {silence:.2f} s after its zero was set. Arming waits for it, at most "
            f"{ZERO_LIMIT * 1e-9:g} s; to avoid that, set the zero with `configure --zero`, and omit zero_at_arming",
        )
    elif abs(samples[-1].position) > ZEROED:
        result.find(
            "zero not set",
            f"after its zero was set, the drive reads {samples[-1].position:.3f} rad: it ignores that frame, or the "
            "joint has moved. Omit zero_at_arming, and declare offset",
        )
    return result
