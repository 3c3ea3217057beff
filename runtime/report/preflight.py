"""The pre-flight table: devices, buses, what the guardian was granted, and what is out of the ordinary."""

from runtime.console.styles import count
from runtime.report.failure_coverage import in_words

ASK = "press Enter to arm; space, q or Ctrl-C end the run without arming"
ASK_AGAIN = "press Enter to look again; space, q or Ctrl-C end the run without arming"


def text(event, paper):
    """Lines. event : of Preflight; paper : runtime.console.styles.Paper"""
    lines = [paper.bold("before arming"), *devices(event["devices"], paper), *buses(event["buses"], paper)]
    if event["guardian"]:
        lines += paper.hang("  guardian  ", ", ".join(event["guardian"]), paper.faint)
    strange = [f"{row['device']}: {why}" for row in event["devices"] for why in row["marks"].values()]
    if strange:
        lines += paper.hang("", f"{count(len(strange), 'thing')} out of the ordinary: {'; '.join(strange)}", paper.bad)
    else:
        lines.append(paper.good(f"{count(len(event['devices']), 'device')}, nothing out of the ordinary"))
    for why in event["refused"]:
        lines += paper.hang("NOT armed: ", why, paper.bad)
    return [*lines, paper.bold(ASK_AGAIN if event["refused"] else ASK)] if event["confirm"] else lines


def devices(rows, paper):
    heads = ("device", "bus and id", "answered", "age", "position", "velocity", "temperature", "fault")
    keys = (None, None, "answered", "age", "position", "velocity", "temperature", "fault")
    table = [cells(row) for row in rows]
    widths = (
        [max(len(head), *(len(line[place]) for line in table), 0) for place, head in enumerate(heads)]
        if table
        else [0] * len(heads)
    )
    lines = ["  " + paper.faint("  ".join(f"{head:<{width}}" for head, width in zip(heads, widths)).rstrip())]
    for row, line in zip(rows, table):
        painted = [
            paper.bad(f"{cell:<{width}}") if key in row["marks"] else f"{cell:<{width}}"
            for key, cell, width in zip(keys, line, widths)
        ]
        lines += paper.hang("  " + "  ".join(painted) + "  ", standing(row), paper.faint, indent=4)
    return lines


def cells(row):
    def number(key, digits, unit):
        return "-" if row[key] is None else f"{row[key]:.{digits}f} {unit}"

    def marked(key, cell):
        return f"{cell} !" if key in row["marks"] else cell

    span = f" in [{row['low']:g}, {row['high']:g}]" if row["low"] is not None else ""
    return [
        row["device"],
        f"{row['bus']} {', '.join(map(str, row['ids'])) or '-'}",
        "yes" if row["answered"] else "no",
        marked("age", "-" if row["age"] is None else f"{row['age'] * 1e3:.1f} ms"),
        marked("position", "-" if row["position"] is None else f"{row['position']:.3f} rad{span}"),
        number("velocity", 2, "rad/s"),
        marked("temperature", number("temperature", 0, "°C")),
        marked("fault", "-" if row["fault_words"] is None else row["fault_words"] or "none"),
    ]


def standing(row):
    """What does not change: the limit, the drive's own time-out, the safe stop."""
    words = [] if row["limit"] is None else [f"limit {row['limit']:g} N·m"]
    if row["stop"] != "nothing to stop":
        words.append(
            "own time-out: none known"
            if row["own_timeout"] is None
            else f"own time-out: {row['own_timeout'] * 1e3:g} ms"
        )
    return "; ".join([*words, f"safe stop: {row['stop']}"])


def buses(rows, paper):
    lines = []
    for bus in rows:
        load = f", load {bus['typical']:.0%}, {bus['worst']:.0%} at worst" if bus["typical"] is not None else ""
        lines += paper.hang(
            f"  bus {bus['bus']}  ", f"{bus['interface'] or 'simulated'} {bus['channel'] or ''}".rstrip() + load
        )
        lines += covered(bus["coverage"], paper, "    ")
    return lines


def covered(found, paper, margin):
    """Two lines of what is covered on a bus, and what is not."""
    yes, no = in_words(found)
    lines = paper.hang(f"{margin}covered: ", yes, paper.faint) if yes else []
    return lines + (paper.hang(f"{margin}not covered: ", no, paper.dubious) if no else [])
