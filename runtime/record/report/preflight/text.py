"""Pre-flight table: devices, buses, privileges of the guardian, and problems."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from cext.safety.thresholds import ARM_HOLD
from runtime.host.console.styles import count
from runtime.record.report.failure_coverage import coverage_lines

if TYPE_CHECKING:
    from runtime.host.console.styles import Console

PAGE = "the run ends in its safe stop if the page with the controls is lost"
ASK = "press Enter to arm; space, q or Ctrl-C end the run without arming"
ASK_AGAIN = "press Enter to check again; space, q or Ctrl-C end the run without arming"


def text(event: dict[str, Any], console: Console) -> list[str]:
    """Return the lines of the table. event : Preflight event; console : runtime.host.console.styles.Console"""
    lines = [console.bold("before arming"), *_devices(event["devices"], console), *_buses(event["buses"], console)]
    if event["guardian"]:
        lines += console.hang("  guardian  ", ", ".join(event["guardian"]), console.faint)
    for place, line in enumerate(event.get("subject", ())):
        lines += console.hang("    " if place else "  limits of ", line)
    if event.get("page"):
        lines += console.hang("  page  ", PAGE, console.faint)
    problems = [f"{row['device']}: {why}" for row in event["devices"] for why in row["marks"].values()]
    if problems:
        lines += console.hang("", f"{count(len(problems), 'problem')}: {'; '.join(problems)}", console.error)
    else:
        lines.append(console.ok(f"{count(len(event['devices']), 'device')}, no problems"))
    for why in event["refused"]:
        lines += console.hang("NOT armed: ", why, console.error)
    if isinstance(event["confirm"], str):
        return [*lines, console.bold(f"hold {event['confirm']} for {1e-9 * ARM_HOLD:g} s to arm")]
    return [*lines, console.bold(ASK_AGAIN if event["refused"] else ASK)] if event["confirm"] else lines


def _devices(rows: Sequence[dict[str, Any]], console: Console) -> list[str]:
    heads = ("device", "bus and id", "answered", "age", "position", "velocity", "temperature", "fault")
    keys = (None, None, "answered", "age", "position", "velocity", "temperature", "fault")
    table = [_cells(row) for row in rows]
    widths = (
        [max(len(head), *(len(line[place]) for line in table), 0) for place, head in enumerate(heads)]
        if table
        else [0] * len(heads)
    )
    if console.width is not None and console.width < sum(widths) + 2 * len(widths):  # a terminal would break the words
        return [line for row, cells in zip(rows, table) for line in _detail_lines(row, heads, cells, console)]
    lines = ["  " + console.faint("  ".join(f"{head:<{width}}" for head, width in zip(heads, widths)).rstrip())]
    for row, line in zip(rows, table):
        styled = [
            console.error(f"{cell:<{width}}") if key in row["marks"] else f"{cell:<{width}}"
            for key, cell, width in zip(keys, line, widths)
        ]
        lines += console.hang("  " + "  ".join(styled) + "  ", standing(row), standing_style(row, console), indent=4)
    return lines


def _detail_lines(row: dict[str, Any], heads: Sequence[str], cells: Sequence[str], console: Console) -> list[str]:
    name, *values = (f"{head} {cell}" for head, cell in zip(("", *heads[1:]), cells))
    return [
        *console.hang(f" {name}  ", "; ".join(values), console.error if row["marks"] else str, indent=4),
        *console.hang("    ", standing(row), standing_style(row, console)),
    ]


def _cells(row: dict[str, Any]) -> list[str]:
    def number(key, digits, unit):
        return "-" if row[key] is None else f"{round(row[key], digits) + 0.0:.{digits}f} {unit}"  # no -0.00

    def mark(key, cell):
        return f"{cell} !" if key in row["marks"] else cell

    span = f" in [{row['low']:g}, {row['high']:g}]" if row["low"] is not None else ""
    return [
        row["device"],
        f"{row['bus']} {', '.join(map(str, row['ids'])) or '-'}",
        "taken out" if row.get("taken_out") else "yes" if row["answered"] else "not yet",
        mark("age", "-" if row["age"] is None else f"{row['age'] * 1e3:.1f} ms"),
        mark("position", "-" if row["position"] is None else number("position", 3, "rad") + span),
        number("velocity", 2, "rad/s"),
        mark("temperature", number("temperature", 0, "°C")),
        mark("fault", "-" if row["fault_words"] is None else row["fault_words"] or "none"),
    ]


def standing(row: dict[str, Any]) -> str:
    """Return the constant properties of a device: torque limit, own time-out, safe stop, settings that differ."""
    limit = row["limit_words"] or ("" if row["limit"] is None else f"limit {row['limit']:g} N·m")
    words = [f"{limit} !" if "limit" in row["marks"] else limit] if limit else []
    words += ["found enabled, and disabled"] if row.get("found_enabled") else []
    words += [row[key] for key in ("enabling", "read_back") if row.get(key)]
    if row["stop"] != "nothing to stop":
        own, declared = row["own_timeout"], ", declared" * row["own_timeout_declared"]
        words.append("own time-out: unknown" if own is None else f"own time-out: {own * 1e3:g} ms{declared}")
    return "; ".join([*words, f"safe stop: {row['stop']}", *row["settings"]])


def standing_style(row: dict[str, Any], console: Console) -> Callable[[str], str]:
    """Return the style of the constant properties of a device."""
    return console.error if "limit" in row["marks"] else console.faint


def _buses(rows: Sequence[dict[str, Any]], console: Console) -> list[str]:
    lines = []
    for bus in rows:
        load = f", load {bus['typical']:.0%}, {bus['worst']:.0%} at worst" if bus["typical"] is not None else ""
        lines += console.hang(
            f"  bus {bus['bus']}  ", f"{bus['interface'] or 'simulated'} {bus['channel'] or ''}".rstrip() + load
        )
        lines += coverage_lines(bus["coverage"], console, "    ")
    return lines
