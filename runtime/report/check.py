"""What `check` has found, for people: sections of aligned lines, each made from the same data that --json prints."""

from graph.drawing.cards import unit_text
from runtime.console.styles import count
from runtime.report.preflight import covered

BAR = 24  # columns of a picture of an interval


def text(found, paper):
    """All lines. found : of runtime.session.check.check; paper : runtime.console.styles.Paper"""
    lines = heading(found, paper)
    if not found["errors"]:
        for section in (ports, schedule, holds, proofs, buses):
            lines += section(found, paper)
    for problem in found["errors"]:
        lines += complaint(problem, paper, paper.bad, "error")
    for problem in found["warnings"]:
        lines += complaint(problem, paper, paper.dubious, "warning")
    return [*lines, "", verdict(found, paper)]


def heading(found, paper):
    if found["rate"] is None:
        return [paper.bold(found["diagram"]) + f"  {found['file']}"]
    wires = sum("source" in port for block in found["blocks"] for port in block["inputs"])
    facts = [f"{found['rate']:g} Hz", count(len(found["blocks"]), "block"), count(wires, "wire")]
    if found["plant"]:
        source = "its own plant" if found["plant"]["given"] else "no plant: every device emulated,"
        facts.append(f"{source} at {found['plant']['rate']:g} Hz")
    return paper.hang(paper.bold(found["diagram"]) + "  ", f"{found['file']}: {', '.join(facts)}")


def section(title, paper, note=""):
    return ["", *paper.hang(paper.bold(title) + "  ", note, paper.faint)] if note else ["", paper.bold(title)]


# Ports


def ports(found, paper):
    lines = section("ports", paper)
    names = [port["name"] for block in found["blocks"] for port in block["inputs"] + block["outputs"]]
    width = max((len(name) for name in names), default=0)
    units = max(
        (len(unit_text(port)) for block in found["blocks"] for port in block["inputs"] + block["outputs"]), default=0
    )
    ranges = max(
        (len(interval(port["low"], port["high"])) for block in found["blocks"] for port in block["outputs"]), default=0
    )
    for block in found["blocks"]:
        holds = f", holds {count(block['hold_exceptions'], 'exception')} in a row" if block["hold_exceptions"] else ""
        lines += paper.hang(f"  {paper.bold(block['path'])}  ", f"{block['type']}, {block['made']}{holds}", paper.faint)
        wired = [port for port in block["inputs"] if "source" in port or "constant" in port]
        unwired = [port for port in block["inputs"] if port not in wired]
        for port in wired:
            origin = f"← {port['source']}" if "source" in port else f"= {port['constant']}"
            lines += paper.hang(f"    in   {port['name']:<{width}}  {unit_text(port):<{units}}  ", origin)
        if unwired:
            lines += paper.hang(
                "    in   ", "not wired: " + ", ".join(f"{p['name']} = {p['default']}" for p in unwired), paper.faint
            )
        for port in block["outputs"]:
            row = (
                f"    out  {port['name']:<{width}}  {unit_text(port):<{units}}  "
                f"{interval(port['low'], port['high']):<{ranges}}  "
            )
            lines += paper.hang(row, "→ " + ", ".join(port["targets"]) if port["targets"] else "")
        if not block["inputs"] and not block["outputs"]:
            lines.append("    in   every port")
    return [line.rstrip() for line in lines]


def interval(low, high):
    """'[-12, 12]'; '' where nothing is known."""
    if low is None and high is None:
        return ""
    return f"[{'-∞' if low is None else format(low, 'g')}, {'∞' if high is None else format(high, 'g')}]"


# Schedule


def schedule(found, paper):
    plan = found["schedule"]
    steps = plan["output"] + plan["update"]
    native = sum(step["native"] for step in steps)
    kinds = f"{count(len(steps), 'step')}: {native} native, {len(steps) - native} Python"
    lines = section("schedule", paper, f"{kinds}; a tick takes the GIL {count(plan['gil_sections'], 'time')}")
    width = max((len(step["block"]) for step in steps), default=0)
    if plan["devices"]:
        lines += paper.hang("  receive  ", ", ".join(plan["devices"]))
    for phase in ("output", "update"):
        for number, step in enumerate(plan[phase], 1):
            how = "native" if step["native"] else "Python"
            gil = f"GIL {step['gil']}" if step["gil"] else ""
            row = (
                f"  {phase if number == 1 else '':<6}  {number:>3}  {step['block']:<{width}}  {how}  "
                f"{step['rate']:>5g} Hz  {gil:<6}"
            )
            lines += paper.hang(row, "while " + " and ".join(step["while"]) if step["while"] else "")
        if phase == "output" and plan["devices"]:
            lines += paper.hang("  command  ", ", ".join(plan["devices"]))
    lines.append(f"  record   {count(plan['recorded'], 'number')} a tick")
    return [line.rstrip() for line in lines]


def holds(found, paper):
    """Where rates meet."""
    if not found["holds"]:
        return []
    lines = section("where rates meet", paper)
    width = max(len(hold["source"]) for hold in found["holds"])
    for hold in found["holds"]:
        before, after = hold["source_every"], hold["target_every"]
        how = "resampled"
        if before % after == 0:
            how = f"held for {before // after} ticks"
        elif after % before == 0:
            how = f"one value in {after // before} is taken"
        lines += paper.hang(f"  {hold['source']:<{width}}  ", f"→ {hold['target']}  {how}")
    return lines


# Proof


def proofs(found, paper):
    if not found["proofs"]:
        return []
    lines = section("proof", paper, "what every command of every actuator provably stays inside")
    commands = {}
    for proof in found["proofs"]:
        commands.setdefault(proof["command"].rpartition(".")[0], []).append(proof)
    width = max(len(proof["command"].rpartition(".")[2]) for proof in found["proofs"])
    for path, own in commands.items():
        lines += paper.hang(f"  {paper.bold(path)}  ", own[0]["rating"], paper.faint)
        wired = [proof for proof in own if proof["bounded_by"] != "a constant"]
        for proof in wired:
            name = proof["command"].rpartition(".")[2]
            inside = (
                f"{interval(proof['low'], proof['high'])} inside "
                f"{interval(proof['limit_low'], proof['limit_high'])} {proof['unit']}"
            )
            lines += paper.hang(f"    {name:<{width}}  {paper.good(bar(proof))}  ", inside)
            lines += paper.hang(
                f"    {'':<{width}}  ", f"bounded by {proof['bounded_by']}, {proof['at']}{slew(proof)}", paper.faint
            )
        still = [f"{proof['command'].rpartition('.')[2]} = {proof['low']:g}" for proof in own if proof not in wired]
        if still:
            lines += paper.hang("    constant: ", ", ".join(still), paper.faint)
        lines += torque(next((bound for bound in found["torque"] if bound["actuator"] == path), None), paper)
        if own[0]["safe_stop"].startswith("damped"):
            lines += paper.hang("    safe stop: ", own[0]["safe_stop"], paper.faint)
    return lines


def slew(proof):
    """'; its whole range in 0.1 s at most, 240 N·m/s' of a command whose change is bounded."""
    if proof["slew"] is None:
        return "; it may step"
    if not proof["slew"]:
        return "; it cannot change"
    return (
        f"; from end to end in {(proof['high'] - proof['low']) / proof['slew']:.3g} s at the fastest, "
        f"{proof['slew']:g} {proof['unit']}/s"
    )


def torque(bound, paper):
    """What bounds the torque of an actuator, where that is more than its commands."""
    if bound is None or bound["bound"] == "proved":
        return []
    words = {"assumed": f"holds {bound['holds']}", "none": bound["holds"]}.get(
        bound["bound"], f"limited {bound['holds']}"
    )
    limit = "" if bound["limit"] is None else f"{bound['limit']:g} N·m, "
    lines = paper.hang("    torque, not proved: ", limit + words, paper.dubious)
    for figure in bound["figures"]:
        lines += paper.hang("      ", f"{figure['description']}: {figure['value']:.3g} {figure['unit']}", paper.faint)
    return lines


def bar(proof):
    """A picture of an interval inside its limit."""
    low, high, floor, roof = (proof[key] for key in ("low", "high", "limit_low", "limit_high"))
    if None in (low, high, floor, roof) or not roof > floor:
        return " " * BAR
    inner = BAR - 2
    begin, end = (min(inner, max(0, round(inner * (value - floor) / (roof - floor)))) for value in (low, high))
    begin, end = min(begin, inner - 1), max(end, min(begin, inner - 1) + 1)
    return "├" + "─" * begin + "█" * (end - begin) + "─" * (inner - end) + "┤"


# Buses


def buses(found, paper):
    if not found["buses"]:
        return []
    lines = section("buses", paper, "on a rig, which failures of the run end in the safe stop all the same")
    width = max(len(bus["bus"]) for bus in found["buses"])
    for bus in found["buses"]:
        if "worst" not in bus:
            kind = {"stream": ": a line of its own", "i2c": ": I2C"}.get(bus["medium"], "")
            lines += paper.hang(f"  {bus['bus']:<{width}}  ", ", ".join(bus["devices"]) + kind)
            lines += covered(bus["coverage"], paper, " " * (width + 4))
            continue
        ink = paper.good if bus["worst"] <= 0.7 else paper.dubious
        filled = min(BAR, round(BAR * bus["worst"]))
        load = f"{bus['typical']:.0%} of {bus['bitrate'] / 1e6:g} Mbit/s, {bus['worst']:.0%} with the worst stuffing"
        load += f"; {bus['frames']:g} frames a second"
        lines += paper.hang(f"  {bus['bus']:<{width}}  {ink('█' * filled)}{paper.faint('░' * (BAR - filled))}  ", load)
        lines += paper.hang(f"  {'':<{width}}  ", ", ".join(bus["devices"]), paper.faint)
        lines += covered(bus["coverage"], paper, " " * (width + 4))
    return lines


# What is wrong


def complaint(problem, paper, ink, severity):
    """A diagnostic, in the words and order in which a run tells it."""
    subject = ".".join(word for word in (problem["path"], problem["port"]) if word)
    mark = f"{severity} {problem['code']}"
    words = [problem["at"], f"{mark} {problem['title']}", subject, problem["message"]]
    first, *rest = paper.hang("", ": ".join(word for word in words if word), indent=4)
    hint = paper.hang("    ", problem["hint"], paper.faint) if problem["hint"] else []
    return ["", first.replace(mark, ink(mark), 1), *rest, *hint]


def verdict(found, paper):
    warnings = count(len(found["warnings"]), "warning")
    if found["errors"]:
        return paper.bad(f"{count(len(found['errors']), 'error')}, {warnings}: this diagram does not run")
    actuators = {proof["command"].rpartition(".")[0] for proof in found["proofs"]}
    rest = {}
    for bound in found["torque"]:
        if bound["bound"] != "proved":
            rest.setdefault(claim(bound), []).append(bound["actuator"])
    proved = len(actuators) - sum(map(len, rest.values()))
    said = [f"every command of {count(proved, 'actuator')} is proved"] if proved > 0 else []
    said += [words.format(" and ".join(paths)) for words, paths in rest.items()]
    return paper.good("ok: " + ", ".join([*said, warnings]))


def claim(bound):
    """On what a torque limit rests, in a few words."""
    return {
        "assumed": f"the torque limit of {{}} holds {bound['holds']}",
        "drive": "the torque of {} is limited by the drive alone",
        "none": "nothing here limits the torque of {}",
    }[bound["bound"]]
