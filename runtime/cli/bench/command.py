"""`python -m runtime bench`: the command line, and what it prints."""

import importlib
from pathlib import Path

from runtime.base.errors import OK, BadInput
from runtime.bench import goals, netlists
from runtime.bench.measure import check, interleave
from runtime.bench.report import Report, machine, words
from runtime.cli.bench import bus, can, clock, sensors, views
from runtime.cli.parsing import Parser, count, number

DIAGRAMS = {"knee": netlists.knee, "wide": netlists.wide, "wide6": netlists.wide6, "chain": netlists.chain}
PARTS = (*DIAGRAMS, "compile")
PEERS = {  # module: its contenders, and what pip calls it
    "drake_peer": (("DrakeCpp", "DrakePython"), "drake"),
    "pathsim_peer": (("PathSim",), "pathsim"),
    "bdsim_peer": (("Bdsim",), "bdsim"),
}
COMMANDS = {"bus": bus, "can": can, "clock": clock, "sensors": sensors, "views": views}
KNEE_EXO = Path(__file__).parents[3] / "diagrams" / "knee_exo.py"


def main(arguments):
    """Returns the exit code."""
    if arguments[:1] == ["start"]:
        return start_command(arguments[1:])
    if arguments and arguments[0] in COMMANDS:
        return COMMANDS[arguments[0]].main(arguments[1:])
    parser = Parser(
        "bench",
        "Measure ticks and compiles on this machine, beside the same by hand and in other frameworks.",
        "`bench start [FILE]` measures start-up and memory, `bench clock` how well the clock is kept, "
        "`bench bus` what\n"
        "buses cost and how soon motors stop after kill -9, `bench can` what eight drives cost a tick, "
        "beside python-can,\n"
        "`bench sensors` what eight inertial sensors on serial lines cost, and what their parser does a "
        "second, and\n"
        "`bench views` how late the loop is with every recorder and viewer on.",
    )
    parser.add_argument("--only", type=parts, default=PARTS, metavar="PART,...", help=f"of {', '.join(PARTS)}")
    parser.add_argument(
        "--seconds",
        type=number("--seconds", "seconds", 60.0),
        default=0.05,
        metavar="S",
        help="of each measurement (default 0.05)",
    )
    parser.add_argument(
        "--repeats",
        type=count("--repeats"),
        default=15,
        metavar="N",
        help="measurements of each row, taken in turn (default 15)",
    )
    parser.add_argument("--json", action="store_true", help="print the same for machines")
    options = parser.parse_args(arguments)
    report = Report(options.json)
    how = (
        f"processor time of one thread; {options.repeats} measurements of {options.seconds:g} s of each row, taken "
        "in turn"
    )
    report.say([how, *words()], **machine())
    for part in options.only:
        if part == "compile":
            compile_part(report)
        else:
            tick_part(report, DIAGRAMS[part](), options.seconds, options.repeats)
    report.finish()
    return OK


def parts(text):
    names = [name.strip() for name in text.split(",")]
    for name in names:
        if name not in PARTS:
            from graph.names import suggestion

            hint = suggestion(name, PARTS) or f"the parts are {', '.join(PARTS)}"
            raise BadInput(f"--only {text}: there is no part {name!r}; {hint}")
    return names


# Ticks


def contenders_of(netlist, with_peers):
    """(contenders, reference first; {name: why it is left out})"""
    from runtime.bench.by_hand import NoCompiler, PlainPython, StraightC
    from runtime.bench.ours import NativeBlocks, PythonBlocks

    reference = PlainPython(netlist)
    found, left_out = [NativeBlocks(netlist), PythonBlocks(netlist), reference], {}
    try:
        found.append(StraightC(netlist))
    except NoCompiler as error:
        left_out[StraightC.name] = str(error)
    for contender in found:
        check(contender, reference)
    for module, (kinds, package) in PEERS.items() if with_peers else ():
        try:
            peers = importlib.import_module(f"runtime.bench.{module}")
        except ImportError as error:
            ours = (error.name or "").split(".")[0] == "runtime"
            left_out[package] = str(error) if ours else "not installed: pip install 'tickwork[bench]'"
            continue
        for kind in kinds:
            try:
                peer = getattr(peers, kind)(netlist)
                check(peer, reference)
                found.append(peer)
            except Exception as error:  # another version of it may do anything
                left_out[getattr(peers, kind).name] = f"{type(error).__name__}: {error}"
    return found, left_out


def tick_part(report, netlist, seconds, repeats):
    contenders, left_out = contenders_of(netlist, netlist.name != "chain")
    times = interleave(contenders, seconds, repeats)
    native = times["Tickwork, native blocks"]
    rows = {
        name: {
            "min": row.least,
            "median": row.median,
            "max": row.most,
            "ns_a_block": row.median * 1e3 / netlist.blocks,
            "times_native": row.over(native),
        }
        for name, row in times.items()
    }
    title = f"{netlist.name}: {netlist.blocks} blocks" + (f" of {netlist.width} elements" if netlist.width > 1 else "")
    lines = ["", f"{title:38}{'µs a tick: min':>16}{'median':>12}{'max':>12}{'ns a block':>13}{'x native':>11}"]
    for name, row in rows.items():
        lines.append(
            f"  {name:36}{row['min']:16.4g}{row['median']:12.4g}{row['max']:12.4g}{row['ns_a_block']:13.3g}{row['times_native']:11.3g}"
        )
    lines += [f"  {name:36}left out: {why}" for name, why in left_out.items()]
    report.say(
        lines,
        **{netlist.name: {"blocks": netlist.blocks, "width": netlist.width, "us_a_tick": rows, "left_out": left_out}},
    )
    report.goals += goals.of_ticks(netlist, times)


# Compiles


def compile_part(report):
    from runtime.bench import compiling

    found = compiling.measure()
    grown, wanted = compiling.exponent(*found[-2:]), compiling.n_log_n(*found[-2:])
    lines = ["", f"{'compile':38}{'ms: min':>16}{'median':>12}{'max':>12}{'µs a block':>13}"]
    for row in found:
        lines.append(
            f"  {f'{row.blocks} blocks':36}{row.compile.least:16.4g}{row.compile.median:12.4g}{row.compile.most:12.4g}"
            f"{row.compile.median * 1e3 / row.blocks:13.3g}"
        )
        lines.append(
            f"  {'  making and wiring them':36}{row.build.least:16.4g}{row.build.median:12.4g}{row.build.most:12.4g}"
            f"{row.build.median * 1e3 / row.blocks:13.3g}"
        )
    lines.append(f"  it grows as blocks^{grown:.2f}; n log n would be blocks^{wanted:.2f} here")
    rows = [
        {
            "blocks": row.blocks,
            **{
                f"{name}_ms": {"min": times.least, "median": times.median, "max": times.most}
                for name, times in (("compile", row.compile), ("build", row.build))
            },
        }
        for row in found
    ]
    report.say(lines, compile={"rows": rows, "exponent": grown, "n_log_n": wanted})
    report.goals += goals.of_compiles(found, grown, wanted)


# Starts


def start_command(arguments):
    from runtime.bench import starting

    parser = Parser("bench start", "Measure the time from the start of a process to its first tick, and its memory.")
    parser.add_argument(
        "file", type=Path, nargs="?", default=KNEE_EXO, help="a diagram file (default: the knee exoskeleton of a clone)"
    )
    parser.add_argument(
        "--repeats",
        type=count("--repeats"),
        default=7,
        metavar="N",
        help="starts of each kind, taken in turn (default 7)",
    )
    parser.add_argument("--json", action="store_true", help="print the same for machines")
    options = parser.parse_args(arguments)
    if not options.file.exists():
        raise BadInput(f"there is no file {options.file}")
    report = Report(options.json)
    report.say([f"{options.repeats} starts of each kind, taken in turn", *words()], **machine())
    found = starting.measure(options.file.resolve(), options.repeats)
    lines = ["", f"{'start':38}{'ms: min':>16}{'median':>12}{'max':>12}{'MB':>13}"]
    for what, (times, memory) in found.items():
        name = f"{options.file.name}, to the first tick" if what == "run" else what
        lines.append(f"  {name:36}{times.least:16.4g}{times.median:12.4g}{times.most:12.4g}{memory.median:13.3g}")
    rows = {
        what: {"ms": {"min": t.least, "median": t.median, "max": t.most}, "resident_mb": m.median}
        for what, (t, m) in found.items()
    }
    report.say(lines, start=rows)
    report.goals += goals.of_start(found)
    report.finish()
    return OK
