"""Text of the `check` command: sections of aligned lines, from the data that --json prints."""

from __future__ import annotations

import html
import json
from collections.abc import Callable, Mapping
from itertools import groupby
from typing import Any

from graph.drawing.cards import unit_text
from runtime.host.console.styles import Console, console_for, count
from runtime.record.report.failure_coverage import coverage_lines
from runtime.session.check.battery import battery_lines

WIDTH = 110  # columns in a notebook
FOLDED = ("ports", "schedule")  # sections that a notebook unfolds
BAR = 24  # columns of an interval bar


class Report(dict):
    """Report of `check`: a dict whose text a notebook and print() show."""

    def __str__(self) -> str:
        return "\n".join(text(self, Console(WIDTH)))

    __repr__ = __str__

    def _repr_html_(self) -> str:
        sections = str(self).split("\n\n")
        groups = groupby(sections, lambda section: section if section.startswith(FOLDED) else "")
        return "".join(_in_html("\n\n".join(texts), bool(folded)) for folded, texts in groups)


def _in_html(text, folded):
    title, _, rest = text.partition("\n") if folded else ("", "", text)
    lines = f'<pre style="line-height: 1.3">{html.escape(rest)}</pre>'
    return f"<details><summary>{html.escape(title)}</summary>{lines}</details>" if folded else lines


def report_lines(report: Mapping[str, Any], as_json: bool) -> list[str]:
    """Return the lines of a report for standard output."""
    return [json.dumps(report, indent=1, ensure_ascii=False)] if as_json else text(report, console_for())


def text(report: Mapping[str, Any], console: Console) -> list[str]:
    """Return all lines of the report. report : as returned by runtime.session.check.report.check"""
    lines = _heading(report, console)
    if not report["errors"]:
        for section in (_ports, _schedule, holds, _proofs, _buses, _page):
            lines += section(report, console)
        lines += battery_lines(report["battery"], console)
        lines += _records(report, console)
        lines += _section("limits of the subject", console) * bool(report["subject"])
        lines += [each for line in report["subject"] for each in console.hang("  ", line)]
    for problem in report["errors"]:
        lines += diagnostic_lines(problem, console, console.error, "error")
    for problem in report["warnings"]:
        lines += diagnostic_lines(problem, console, console.warn, "warning")
    return [*lines, "", _verdict(report, console)]


def _heading(report: Mapping[str, Any], console: Console) -> list[str]:
    if report["rate"] is None:
        return [console.bold(report["diagram"]) + f"  {report['file']}"]
    wires = sum("source" in port for block in report["blocks"] for port in block["inputs"])
    facts = [f"{report['rate']:g} Hz", count(len(report["blocks"]), "block"), count(wires, "wire")]
    if report["plant"]:
        source = "its own plant" if report["plant"]["given"] else "no plant: every device emulated,"
        facts.append(f"{source} at {report['plant']['rate']:g} Hz")
    return console.hang(console.bold(report["diagram"]) + "  ", f"{report['file']}: {', '.join(facts)}")


def _section(title: str, console: Console, note: str = "") -> list[str]:
    return ["", *console.hang(console.bold(title) + "  ", note, console.faint)] if note else ["", console.bold(title)]


# Ports


def _ports(report: Mapping[str, Any], console: Console) -> list[str]:
    lines = _section("ports", console)
    names = [port["name"] for block in report["blocks"] for port in block["inputs"] + block["outputs"]]
    width = max((len(name) for name in names), default=0)
    units = max(
        (len(unit_text(port)) for block in report["blocks"] for port in block["inputs"] + block["outputs"]), default=0
    )
    ranges = max(
        (len(interval(port["low"], port["high"])) for block in report["blocks"] for port in block["outputs"]), default=0
    )
    for block in report["blocks"]:
        holds = f", holds {count(block['hold_exceptions'], 'exception')} in a row" if block["hold_exceptions"] else ""
        lines += console.hang(
            f"  {console.bold(block['path'])}  ", f"{block['type']}, {block['made']}{holds}", console.faint
        )
        wired = [port for port in block["inputs"] if "source" in port or "constant" in port]
        unwired = [port for port in block["inputs"] if port not in wired]
        for port in wired:
            origin = f"← {port['source']}" if "source" in port else f"= {port['constant']}"
            lines += console.hang(f"    in   {port['name']:<{width}}  {unit_text(port):<{units}}  ", origin)
        if unwired:
            lines += console.hang(
                "    in   ", "not wired: " + ", ".join(f"{p['name']} = {p['default']}" for p in unwired), console.faint
            )
        for port in block["outputs"]:
            row = (
                f"    out  {port['name']:<{width}}  {unit_text(port):<{units}}  "
                f"{interval(port['low'], port['high']):<{ranges}}  "
            )
            lines += console.hang(row, "→ " + ", ".join(port["targets"]) if port["targets"] else "")
        if not block["inputs"] and not block["outputs"]:
            lines.append("    in   every port")
    return [line.rstrip() for line in lines]


def interval(low: float | None, high: float | None) -> str:
    """Return an interval as text, such as '[-12, 12]'; '' if neither bound is known."""
    if low is None and high is None:
        return ""
    return f"[{'-∞' if low is None else format(low, 'g')}, {'∞' if high is None else format(high, 'g')}]"


# Schedule


def _schedule(report: Mapping[str, Any], console: Console) -> list[str]:
    plan = report["schedule"]
    steps = plan["output"] + plan["update"]
    native = sum(step["native"] for step in steps)
    kinds = f"{count(len(steps), 'step')}: {native} native, {len(steps) - native} Python"
    lines = _section("schedule", console, f"{kinds}; each tick acquires the GIL {count(plan['gil_sections'], 'time')}")
    width = max((len(step["block"]) for step in steps), default=0)
    if plan["devices"]:
        lines += console.hang("  receive  ", ", ".join(plan["devices"]))
    for phase in ("output", "update"):
        for number, step in enumerate(plan[phase], 1):
            how = "native" if step["native"] else "Python"
            gil = f"GIL {step['gil']}" if step["gil"] else ""
            row = (
                f"  {phase if number == 1 else '':<6}  {number:>3}  {step['block']:<{width}}  {how}  "
                f"{step['rate']:>5g} Hz  {gil:<6}"
            )
            lines += console.hang(row, "while " + " and ".join(step["while"]) if step["while"] else "")
        if phase == "output" and plan["devices"]:
            lines += console.hang("  command  ", ", ".join(plan["devices"]))
    lines.append(f"  record   {count(plan['recorded'], 'number')} per tick")
    lines += fused_lines(steps, console)
    if plan["allowance"]:
        lines += console.hang(
            "  watchdog ", f"allows a tick {plan['allowance'] * 1e3:g} ms beyond its limit, as its blocks declare"
        )
    return [line.rstrip() for line in lines]


def fused_lines(steps: list[Mapping[str, Any]], console: Console) -> list[str]:
    """Return the lines on the native steps in machine code, and why the others are called one by one."""
    native = [step for step in steps if step["native"]]
    if not native:
        return []
    lines = console.hang(
        "  fused    ", f"{sum(step['fused'] for step in native)} of {count(len(native), 'native step')}"
    )
    blocks = {}
    for step in native:
        if not step["fused"]:
            blocks.setdefault(step["obstacle"], []).append(step["block"])
    for reason, names in blocks.items():
        text = reason if len(names) == len(native) else f"{reason}: {', '.join(dict.fromkeys(names))}"
        lines += console.hang(" " * 11, text, console.faint)
    return lines


def holds(report: Mapping[str, Any], console: Console) -> list[str]:
    """Return the lines on signals that connect blocks of different rates."""
    if not report["holds"]:
        return []
    lines = _section("where rates meet", console)
    width = max(len(hold["source"]) for hold in report["holds"])
    for hold in report["holds"]:
        before, after = hold["source_every"], hold["target_every"]
        how = "resampled"
        if before % after == 0:
            how = f"held for {before // after} ticks"
        elif after % before == 0:
            how = f"one of {after // before} values is used"
        lines += console.hang(f"  {hold['source']:<{width}}  ", f"→ {hold['target']}  {how}")
    return lines


# Proof


def _proofs(report: Mapping[str, Any], console: Console) -> list[str]:
    if not report["proofs"]:
        return []
    lines = _section("proof", console, "proved range of every actuator command")
    commands = {}
    for proof in report["proofs"]:
        commands.setdefault(proof["command"].rpartition(".")[0], []).append(proof)
    width = max(len(proof["command"].rpartition(".")[2]) for proof in report["proofs"])
    for path, own in commands.items():
        lines += console.hang(f"  {console.bold(path)}  ", own[0]["rating"], console.faint)
        wired = [proof for proof in own if proof["bounded_by"] != "a constant"]
        for proof in wired:
            name = proof["command"].rpartition(".")[2]
            inside = (
                f"{interval(proof['low'], proof['high'])} inside "
                f"{interval(proof['limit_low'], proof['limit_high'])} {proof['unit']}"
            )
            lines += console.hang(f"    {name:<{width}}  {console.ok(bar(proof))}  ", inside)
            lines += console.hang(
                f"    {'':<{width}}  ", f"bounded by {proof['bounded_by']}, {proof['at']}{slew(proof)}", console.faint
            )
        still = [f"{proof['command'].rpartition('.')[2]} = {proof['low']:g}" for proof in own if proof not in wired]
        if still:
            lines += console.hang("    constant: ", ", ".join(still), console.faint)
        lines += torque(next((bound for bound in report["torque"] if bound["actuator"] == path), None), console)
        if own[0]["safe_stop"].startswith("damped"):
            lines += console.hang("    safe stop: ", own[0]["safe_stop"], console.faint)
    return lines


def slew(proof: Mapping[str, Any]) -> str:
    """Return the rate bound of a command as text, such as '; at most 240 N·m/s: full range in 0.1 s'."""
    if proof["slew"] is None:
        return "; rate not limited"
    if not proof["slew"]:
        return "; constant"
    return (
        f"; at most {proof['slew']:g} {proof['unit']}/s: "
        f"full range in {(proof['high'] - proof['low']) / proof['slew']:.3g} s"
    )


def torque(bound: Mapping[str, Any] | None, console: Console) -> list[str]:
    """Return the lines on an actuator's torque limit if its proved commands do not bound it, and on unread settings."""
    if bound is None:
        return []
    unread = (
        console.hang("    settings not read back: ", ", ".join(bound["unread"]), console.warn)
        if bound["unread"]
        else []
    )
    if bound["bound"] == "proved":
        return unread
    words = {"assumed": f"holds {bound['holds']}", "none": bound["holds"]}.get(
        bound["bound"], f"limited {bound['holds']}"
    )
    limit = "" if bound["limit"] is None else f"{bound['limit']:g} N·m, "
    lines = console.hang("    torque, not proved: ", limit + words, console.warn)
    for figure in bound["figures"]:
        lines += console.hang(
            "      ", f"{figure['description']}: {figure['value']:.3g} {figure['unit']}", console.faint
        )
    return lines + unread


def bar(proof: Mapping[str, Any]) -> str:
    """Draw an interval inside its limit as a bar of `BAR` characters."""
    low, high, floor, roof = (proof[key] for key in ("low", "high", "limit_low", "limit_high"))
    if None in (low, high, floor, roof) or not roof > floor:
        return " " * BAR
    inner = BAR - 2
    begin, end = (min(inner, max(0, round(inner * (value - floor) / (roof - floor)))) for value in (low, high))
    begin, end = min(begin, inner - 1), max(end, min(begin, inner - 1) + 1)
    return "├" + "─" * begin + "█" * (end - begin) + "─" * (inner - end) + "┤"


# Buses

LINES = {  # text of a medium or kind of line
    "i2c": "I2C",
    "spi": "SPI",
    "serial": "serial line",
    "dialogue": "serial line",
    "net": "network",
    "lsl": "LSL stream",
    "ros2": "ROS 2 topic",
    "gpio": "GPIO line",
    "evdev": "input device",
}


def _buses(report: Mapping[str, Any], console: Console) -> list[str]:
    if not report["buses"]:
        return []
    lines = _section("buses", console, "failures of a run on a rig that still end in the safe stop")
    width = max(len(bus["bus"]) for bus in report["buses"])
    for bus in report["buses"]:
        if "worst" not in bus:
            kind = LINES.get(bus["line"] or bus["medium"], bus["line"])
            lines += console.hang(
                f"  {bus['bus']:<{width}}  ", ", ".join(bus["devices"]) + (f": {kind}" if kind else "")
            )
            lines += coverage_lines(bus["coverage"], console, " " * (width + 4))
            continue
        style = console.ok if bus["worst"] <= 0.7 else console.warn
        filled = min(BAR, round(BAR * bus["worst"]))
        rate = f"{bus['bitrate'] / 1e6:g} Mbit/s" + (
            f" and {bus['data_bitrate'] / 1e6:g} Mbit/s (data of CAN FD)" if bus["data_bitrate"] else ""
        )
        load = f"{bus['typical']:.0%} of {rate}, {bus['worst']:.0%} with " + (
            "10 µs between frames" if bus["medium"] == "spi" else "worst-case stuffing"
        )
        load += f"; {bus['frames']:g} frames/s"
        lines += console.hang(
            f"  {bus['bus']:<{width}}  {style('█' * filled)}{console.faint('░' * (BAR - filled))}  ", load
        )
        lines += console.hang(f"  {'':<{width}}  ", ", ".join(bus["devices"]), console.faint)
        lines += coverage_lines(bus["coverage"], console, " " * (width + 4))
    return lines


def _page(report: Mapping[str, Any], console: Console) -> list[str]:
    if report["page"] is None:
        return []
    words = (
        f'{report["page"]["panel"]} has lost="stop": no drive of a rig is enabled before a page has the controls, and '
        f"the run ends in its safe stop if that page is lost, or has not replied to values for "
        f"{report['page']['silence'] * 1e3:g} ms"
    )
    return ["", *console.hang(console.bold("page") + "  ", words)]


def _records(report: Mapping[str, Any], console: Console) -> list[str]:
    if not report["records"]:
        return []
    lines = _section("records", console, "what rests on a record of `commission`; the rest rests on tables")
    width = max(len(row["device"]) for row in report["records"])
    for row in report["records"]:
        words, style = "no record: every number is that of a table", console.faint
        if row["serial"] is not None:
            words, style = f"{row['serial']}, {row['by']}, {row['date']}: {', '.join(row['agrees']) or 'nothing'}", str
        if row["mismatches"]:
            words, style = f"{row['serial']} does not apply: it {'; it '.join(row['mismatches'])}", console.warn
        elif row["findings"]:
            words, style = f"{words}; found: {', '.join(row['findings'])}", console.warn
        lines += console.hang(f"  {row['device']:<{width}}  ", words, style)
    return lines


# Errors and warnings


def diagnostic_lines(
    problem: Mapping[str, str], console: Console, style: Callable[[str], str], severity: str
) -> list[str]:
    """Return the lines of a diagnostic, in the format of a run's errors."""
    subject = ".".join(word for word in (problem["path"], problem["port"]) if word)
    mark = f"{severity} {problem['code']}"
    words = [problem["at"], f"{mark} {problem['title']}", subject, problem["message"]]
    first, *rest = console.hang("", ": ".join(word for word in words if word), indent=4)
    hint = console.hang("    ", problem["hint"], console.faint) if problem["hint"] else []
    return ["", first.replace(mark, style(mark), 1), *rest, *hint]


def _verdict(report: Mapping[str, Any], console: Console) -> str:
    warnings = count(len(report["warnings"]), "warning")
    if report["errors"]:
        return console.error(f"{count(len(report['errors']), 'error')}, {warnings}: the diagram cannot run")
    actuators = {proof["command"].rpartition(".")[0] for proof in report["proofs"]}
    rest = {}
    for bound in report["torque"]:
        if bound["bound"] != "proved":
            rest.setdefault(claim(bound), []).append(bound["actuator"])
    deviating = sorted({caveat["actuator"] for caveat in report["caveats"] if caveat["deviates"]})
    if deviating:
        rest["the torque limit of {} rests on settings that differ from the table"] = deviating
    proved = len(actuators - {path for paths in rest.values() for path in paths})
    statements = [f"every command of {count(proved, 'actuator')} is proved"] if proved > 0 else []
    statements += [words.format(" and ".join(paths)) for words, paths in rest.items()]
    return console.ok("ok: " + ", ".join([*statements, warnings]))


def claim(bound: Mapping[str, Any]) -> str:
    """Return a format string that states the assumptions of a torque limit."""
    return {
        "assumed": f"the torque limit of {{}} holds {bound['holds']}",
        "drive": "the torque of {} is limited by the drive alone",
        "none": "nothing limits the torque of {}",
    }[bound["bound"]]
