"""Report of a scan, as text for the terminal and as a first rig file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from runtime.host.console.styles import count
from runtime.robot.rig.file import I2C
from runtime.setup.commissioning.bus import entry, in_candump

if TYPE_CHECKING:
    from graph.family import Answer
    from runtime.robot.rig.file import RigBus
    from runtime.setup.commissioning.scan import Report


def text(report: Report, verbose: bool = False) -> list[str]:
    """Return the lines of a report. report : runtime.setup.commissioning.scan.Report"""
    if report.interface == I2C:
        return _chips(report)
    lines = [f"bus {report.bus}  {report.interface} {report.channel} at {report.bitrate} bit/s"]
    lines += [f"  id {drive.can_id:<4} {drive.family}{state(drive)}" for drive in report.drives]
    for node in report.nodes:
        sends = (
            ", ".join(f"{what} {rate:.0f} Hz" for what, rate in sorted(node.sends.items()))
            or "sends no measurements unasked"
        )
        name = (
            f"  manufacturer {node.manufacturer}, function {node.function}, NAME {node.unique}"
            if node.manufacturer is not None
            else ""
        )
        lines.append(
            f"  address {node.address:<4} {node.family}  {sends}{name}"
            + (f"  firmware {node.firmware}" if node.firmware else "")
        )
    for drive in report.drives:
        lines += [f"  id {drive.can_id}: {note}" for note in drive.notes]
        lines += [f"  ! id {drive.can_id}: {remark}" for remark in drive.remarks]
    lines += [
        f"  ! {remark}" for remark in [*(remark for node in report.nodes for remark in node.remarks), *report.remarks]
    ]
    if report.others:
        lines.append(f"  also received: {', '.join(report.others[:8])}" + (" ..." if len(report.others) > 8 else ""))
    return lines + lines_of_frames(report, verbose)


def _chips(report: Report) -> list[str]:
    lines = [f"bus {report.bus}  {report.interface} {report.channel}"]
    for chip in report.chips:
        lines.append(f"  {chip.where:<12}{chip.name or 'unknown chip'}" + (f"  ({chip.how})" if chip.how else ""))
    return lines + [f"  ! {remark}" for remark in report.remarks]


def state(drive: Answer) -> str:
    """Return the state of a drive as one line."""

    def number(value, digits, unit):
        return [] if value is None else [f"{value:.{digits}f} {unit}"]

    parts = [
        *number(drive.position, 3, "rad"),
        *number(drive.velocity, 2, "rad/s"),
        *number(drive.torque, 2, "N·m"),
        *number(drive.current, 2, "A"),
        *number(drive.temperature, 0, "°C"),
        *number(drive.voltage, 1, "V"),
        _fault(drive),
        *([f"firmware {drive.firmware}"] if drive.firmware else []),
        *([f"unique {drive.unique}"] if drive.unique else []),
    ]
    return "  " + ", ".join(parts)


def _fault(drive: Answer) -> str:
    return "faults not reported" if drive.fault is None else f"fault: {drive.fault}" if drive.fault else "no fault"


def lines_of_frames(report: Report, verbose: bool) -> list[str]:
    """Return lines about the frames sent: one line per reason, or one per frame if verbose."""
    if not report.sent:
        return ["  sent: nothing"]
    if verbose:
        return [
            "  sent:",
            *(
                f"    {in_candump(identifier, extended, data)}  {why}"
                for identifier, extended, data, why in report.sent
            ),
        ]
    groups = {}
    for identifier, extended, data, why in report.sent:
        groups.setdefault(why, []).append(in_candump(identifier, extended, data))
    return [
        f"  sent: {why}, {count(len(frames), 'frame')}"
        + (f", {frames[0]} to {frames[-1]}" if len(frames) > 1 else f", {frames[0]}")
        for why, frames in groups.items()
    ]


def rig(reports: Sequence[Report], buses: Sequence[RigBus], when: str) -> str:
    """Return a rig file with the buses, and the devices found on them as comments.

    buses : RigBus of each report, in the same order; when : date and time for the first line
    """
    lines = [
        f"# Devices found by `scan` on {when}. Uncomment an entry and replace its name with the path of its block in "
        "the diagram.",
        "",
    ]
    for report, bus in zip(reports, buses):
        lines += [*entry(bus), ""]
        for drive in report.drives:
            lines += [f"# {drive.family}{state(drive)}", *(f"# ! {remark}" for remark in drive.remarks)]
            settings = [f"# {name} = {value}" for name, value in drive.settings.items()]
            lines += [
                f'# [device."{drive.block.lower() or "drive"}_{drive.can_id}"]',
                f"# can_id = {drive.can_id}",
                *settings,
                "",
            ]
        for node in report.nodes:
            lines += [
                f"# {node.family} at address {node.address}" + (f", firmware {node.firmware}" if node.firmware else "")
            ]
            lines += [f'# [device."{"imu" if node.kind is not None else "node"}_{node.address}"]']
            lines += [f"# address = {node.address}", f"# bitrate = {report.bitrate}"] * (node.kind is not None) + [""]
        for chip in report.chips:
            lines += [f"# {chip.where}: {chip.name or 'unknown chip'}"]
            if chip.block:
                where = [f"# mux = {chip.mux:#04x}", f"# channel = {chip.channel}"] if chip.mux else []
                lines += [f'# [device."{chip.path}"]', f"# address = {chip.address:#04x}", *where, ""]
    return "\n".join(lines)
