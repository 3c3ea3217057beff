"""The command line: `python -m runtime FILE` runs a diagram; the other commands look at one, or at this machine."""

import argparse
import math
import os
import re
import sys
from pathlib import Path

from runtime.errors import BAD_INPUT, CHECK_FAILED, OK, BadInput
from runtime.terminal import complain, program, tell

COMMANDS = {
    "run": "run a diagram, in simulation",
    "check": "compile a diagram and tell what was found: ports, schedule, proof, buses",
    "draw": "draw a diagram: SVG, PNG, Mermaid, or a page to explore",
    "replay": "run a recording again, bit for bit, or through a changed diagram",
    "diff": "compare two recordings: a table and a picture",
    "blocks": "list the blocks that are installed, or tell all about one",
    "profile": "run a diagram and tell where the time of a tick goes, block by block",
    "bench": "measure ticks and blocks on this machine",
    "doctor": "look whether this machine is fit to run a robot, and what to change",
    "set": "change live parameters of a run that goes on, or list them",
}
LONGEST = 1e9                   # s: 30 years
INTERRUPTED = 130


def main(arguments=None):
    """Run a command line. Returns the exit code."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    from graph import DiagramError

    try:
        code = command(arguments)
    except BadInput as error:
        complain([f"tickwork: {error}"])
        code = error.code
    except DiagramError as error:
        count = len(error.diagnostics)
        complain([*map(str, error.diagnostics), f"tickwork: {count} error{'s' * (count > 1)}; nothing was armed"])
        code = CHECK_FAILED
    except KeyboardInterrupt:
        complain(["tickwork: stopped by Ctrl-C; nothing is armed"])
        code = INTERRUPTED
    tell([])                                    # what the user's own code has printed
    return code


def command(arguments):
    if not arguments or arguments[0] in ("-h", "--help"):
        (tell if arguments else complain)(usage())
        return OK if arguments else BAD_INPUT
    first = arguments[0]
    if first not in COMMANDS:
        from graph.block import suggestion

        if not first.startswith("-") and not Path(first).suffix and not Path(first).exists() and suggestion(first, COMMANDS):
            raise BadInput(f"there is neither a command nor a file {first!r}; {suggestion(first, COMMANDS)}")
        return run_command(arguments)
    commands = {
        "run": run_command, "check": check_command, "draw": draw_command, "replay": replay_command, "diff": diff_command,
        "blocks": blocks_command, "profile": profile_command, "bench": bench_command, "doctor": doctor_command,
        "set": set_command,
    }
    return commands[first](arguments[1:])


def usage():
    lines = [f"usage: {program()} FILE [options]      run a diagram; FILE is Python, such as diagrams/knee_exo.py"]
    lines += [f"       {program()} {name:<10} ...      {text}" for name, text in COMMANDS.items() if name != "run"]
    lines.append(f"       {program()} COMMAND --help      the options of run, {' and '.join(name for name in COMMANDS if name != 'run')}")
    return lines


class Parser(argparse.ArgumentParser):
    """Wrong options raise BadInput, in one line. They are not completed: what is short for one today may be another's name tomorrow."""

    def __init__(self, name, description, epilog=None):
        super().__init__(prog=f"{program()} {name}", description=description, epilog=epilog, allow_abbrev=False,
                         formatter_class=argparse.RawDescriptionHelpFormatter)
        self.name = name

    def parse_args(self, arguments):
        options, unknown = self.parse_known_args(arguments)
        if unknown:
            self.error(self.explain(unknown[0]))
        return options

    def explain(self, word):
        from graph.block import suggestion

        if not word.startswith("-"):
            return f"{word!r} is one word too many"
        hint = suggestion(word.partition("=")[0], self._option_string_actions)
        return f"there is no option {word}" + (f"; {hint}" if hint else "")

    def error(self, message):
        if message.endswith("required: FILE"):
            message = "which file? name a diagram file, such as diagrams/knee_exo.py"
        raise BadInput(f"{message} ({program()} {self.name} --help lists the options)")


def run_command(arguments):
    from runtime import report

    result = carried_out(parse_run(arguments))
    tell(report.summary(result))
    if result.request.profile and not result.outcome.faulted:
        tell(profiled(result))
    if not result.outcome.faulted:
        tell(report.hints(result, program()))
    return report.exit_code(result.outcome)


def carried_out(request):
    """The Result of a run, with what went wrong told."""
    from runtime import fault, report
    from runtime.realtime import RealtimeRefused
    from runtime.recorder import RecorderError
    from runtime.run import prepare, run

    prepared = prepare(request)
    complain(map(str, prepared.schedule.warnings))
    try:
        result = run(prepared, complain)
    except (RealtimeRefused, RecorderError) as error:
        raise BadInput(str(error)) from None
    if result.outcome.faulted:
        complain(fault.explain(result))
    elif report.stopped(result.outcome):
        complain([report.stopped(result.outcome)])
    return result


def profiled(result):
    from cext.stopwatch import time_of_lap
    from runtime.profile import table

    return table(result, time_of_lap())


def parse_run(arguments):
    """Command-line words to a Request. BadInput says which is wrong."""
    from runtime.realtime import HIGHEST, MODES, PRIORITY
    from runtime.run import Request

    parser = Parser("run", "Run a diagram in simulation.")
    add_diagram(parser)
    parser.add_argument("--duration", type=number("--duration", "seconds", LONGEST), metavar="S",
                        help="stop after S seconds (default: Ctrl-C)")
    parser.add_argument("--fast", action="store_true", help="virtual time: as fast as the machine can (needs --duration)")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--record", type=folder, metavar="DIR", help="folder of the recording (default: recordings)")
    where.add_argument("--no-record", action="store_true", help="write no files")
    parser.add_argument("--trial", nargs="+", default=[], metavar="NAME=VALUE",
                        help="what this trial is: subject=S03 condition=assist notes='new shoes'")
    parser.add_argument("--plotjuggler", type=host_and_port, metavar="HOST:PORT", help="where PlotJuggler listens")
    parser.add_argument("--realtime", choices=MODES, default="off",
                        help="ask the system for real-time priority, locked memory and processors that stay awake: try takes what is "
                             "granted and tells of the rest, require does not start without (default: off, as a simulation moves nobody)")
    parser.add_argument("--priority", type=count("--priority", HIGHEST), metavar="N",
                        help=f"of SCHED_FIFO, 1 to {HIGHEST} (default: {PRIORITY})")
    parser.add_argument("--cpu", type=processor, metavar="N",
                        help="stay on this processor (default: the last isolated one, if one is isolated)")
    add_pace(parser)
    parser.add_argument("--profile", action="store_true", help="time every block, and tell at the end where the time of a tick goes")
    options = parser.parse_args(arguments)
    if options.fast and options.duration is None:
        raise BadInput("--fast needs --duration S: virtual time ends when that has passed")
    if options.fast and options.realtime != "off":
        raise BadInput(f"--realtime {options.realtime} and --fast exclude each other: virtual time waits for nothing")
    for name in ("priority", "cpu"):
        if options.realtime == "off" and getattr(options, name) is not None:
            raise BadInput(f"--{name} needs --realtime try or --realtime require")
    return Request(
        file=options.file, rate=options.rate, duration=options.duration, fast=options.fast, settings=settings(options.settings),
        record=options.record, no_record=options.no_record, plotjuggler=options.plotjuggler, trial=trial(options.trial),
        realtime=options.realtime, priority=options.priority or PRIORITY, cpu=options.cpu, overrun=options.overrun, spin=options.spin,
        profile=options.profile)


def add_pace(parser):
    from runtime.timing import overrun_policy, spin_window

    parser.add_argument("--overrun", type=overrun_policy, default="skip", metavar="POLICY",
                        help="of a tick that comes too late: skip (default), catch-up:N ticks run late at most, fault:N missed in a row, "
                             "fault:N/WINDOW; or several, with commas")
    parser.add_argument("--spin", type=spin_window, default=0.0, metavar="TIME",
                        help="spin instead of sleeping this long before a deadline: 50us")


def add_diagram(parser):
    """The diagram, and what changes it before it is compiled."""
    parser.add_argument("file", type=Path, metavar="FILE", help="a diagram file, such as diagrams/knee_exo.py")
    parser.add_argument("--rate", type=number("--rate", "Hz"), metavar="HZ", help="ticks a second instead of the diagram's own")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", dest="settings",
                        help="a parameter of build() or plant(), or of a block: left/impedance.stiffness=40, angle='60 deg'; "
                             "@FILE reads such settings, one a line")


def number(option, unit, most=math.inf):
    def parse(text):
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0.0 < value < math.inf:
            raise BadInput(f"{option} {text}: expected a number of {unit} above 0")
        if value > most:
            raise BadInput(f"{option} {text}: at most {most:g} {unit}")
        return value

    return parse


def count(option, most=math.inf):
    def parse(text):
        if not text.isdecimal() or int(text) < 1:
            raise BadInput(f"{option} {text}: expected a whole number, 1 or more")
        if int(text) > most:
            raise BadInput(f"{option} {text}: at most {most}")
        return int(text)

    return parse


def processor(text):
    here = os.sysconf("SC_NPROCESSORS_CONF")
    if not text.isdecimal() or int(text) >= here:
        raise BadInput(f"--cpu {text}: expected the number of a processor, and this machine has 0 to {here - 1}")
    return int(text)


def folder(text):
    if not text:
        raise BadInput("--record: expected a folder, and got nothing")
    return Path(text).expanduser()


def trial(texts):
    """Fields of a trial, as a dict of texts."""
    fields = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not re.fullmatch(r"[^\W\d]\w*", name):
            raise BadInput(f"--trial {text}: expected NAME=VALUE, as in subject=S03")
        if name in fields:
            raise BadInput(f"--trial: {name} was given twice")
        fields[name] = value
    return fields


def settings(words, option="--set "):
    """Pairs (name, text) of NAME=VALUE words; @FILE stands for the lines of a file, in which `#` and a space begin a remark."""
    found = []
    for word in words:
        if not word.startswith("@"):
            found.append(setting(word, f"{option}{word}", option))
            continue
        try:
            lines = Path(word[1:]).expanduser().read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise BadInput(f"{option}{word}: cannot read the file: {getattr(error, 'strerror', None) or error}") from None
        found += [
            setting(line, f"{word[1:]}:{number}: {line}", option) for number, line in enumerate(map(str.strip, lines), 1)
            if line and line != "#" and not line.startswith("# ")]
    return found


def setting(text, told, option="--set "):
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise BadInput(f"{told}: expected NAME=VALUE, as in {option}left/impedance.stiffness=40")
    return name.strip(), value.strip()


def host_and_port(text):
    host, colon, port = text.rpartition(":")
    if not colon:
        host, port = text, "9870"
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise BadInput(f"--plotjuggler {text}: expected HOST:PORT, as in 127.0.0.1:9870")
    return host.strip("[]"), int(port)


def check_command(arguments):
    from runtime.check import KEYS, check, told

    parser = Parser("check", "Compile a diagram and tell what was found. The exit code is 1 where something is wrong.", KEYS)
    add_diagram(parser)
    parser.add_argument("--json", action="store_true", help="for machines: one JSON object with the keys below")
    options = parser.parse_args(arguments)
    found = check(options.file, settings(options.settings), options.rate)
    tell(told(found, options.json))
    return OK if found["ok"] else CHECK_FAILED


def draw_command(arguments):
    from runtime.draw import FORMATS, draw_file

    parser = Parser("draw", "Draw a diagram, from left to right; feedback goes back below, dashed.")
    add_diagram(parser)
    parser.add_argument("-o", "--output", metavar="NAME", help="file to write, - for standard output (default: the diagram's name)")
    parser.add_argument("--format", choices=list(FORMATS),
                        help="svg, for papers; png; mermaid, for Markdown; html, a page to explore (default: what NAME ends in, or svg)")
    parser.add_argument("--all-ports", action="store_true", help="show the ports that nothing is wired to as well")
    options = parser.parse_args(arguments)
    said, remarks = draw_file(options.file, settings(options.settings), options.rate, options.output, options.format, options.all_ports)
    complain(remarks)
    tell(said)
    return OK


def blocks_command(arguments):
    from runtime.catalog import catalog

    parser = Parser("blocks", "List the blocks that are installed, or tell all about one.")
    parser.add_argument("name", nargs="?", metavar="NAME", help="a block, such as TorqueLimiter, or a family of blocks, such as limiters")
    parser.add_argument("--from", dest="library", metavar="LIBRARY", help="only this library's blocks, and what is known of it")
    parser.add_argument("--actuators", action="store_true", help="the models of actuators with their rated, peak and wire torques")
    options = parser.parse_args(arguments)
    tell(catalog(options.name, options.library, options.actuators))
    return OK


def replay_command(arguments):
    from runtime.replay import replay, told

    parser = Parser("replay", "Run a recording again: from what its buses received, on the recorded clock, with nothing connected.")
    parser.add_argument("recording", type=Path, metavar="RECORDING", help="the .mcap file of a recording")
    parser.add_argument("--diagram", type=Path, metavar="FILE", help="run this diagram instead of the one that was recorded")
    parser.add_argument("--record", type=folder, metavar="DIR", help="keep the new recording in this folder")
    options = parser.parse_args(arguments)
    result = replay(options.recording, options.diagram, options.record)
    tell(told(result))
    return OK if result.same else CHECK_FAILED


def diff_command(arguments):
    from runtime import diff
    from runtime.compare import compare
    from runtime.trial import Trial

    parser = Parser("diff", "Compare two recordings, tick by tick.")
    parser.add_argument("first", type=Path, metavar="A", help="the .mcap file of a recording")
    parser.add_argument("second", type=Path, metavar="B", help="and of another")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="where to draw what differs (default: diff.png)")
    options = parser.parse_args(arguments)
    here, there = Trial(options.first), Trial(options.second)
    comparison = compare(here, there)
    tell(diff.table(here, there, comparison))
    if comparison.differences:
        tell([f"  {diff.draw(options.output or Path('diff.png'), here, there, comparison)}"])
    return OK if comparison.identical else CHECK_FAILED


def profile_command(arguments):
    from runtime import report
    from runtime.profile import picture
    from runtime.run import Request

    parser = Parser("profile", "Run a diagram in simulation, and tell where the time of a tick goes, block by block.")
    add_diagram(parser)
    parser.add_argument("--duration", type=number("--duration", "seconds", LONGEST), default=5.0, metavar="S",
                        help="stop after S seconds (default: 5)")
    parser.add_argument("--fast", action="store_true", help="virtual time: as fast as the machine can")
    parser.add_argument("-o", "--output", type=Path, metavar="NAME", help="picture to write (default: the diagram's name, _profile.png)")
    add_pace(parser)
    options = parser.parse_args(arguments)
    result = carried_out(Request(
        file=options.file, rate=options.rate, duration=options.duration, fast=options.fast, settings=settings(options.settings),
        no_record=True, overrun=options.overrun, spin=options.spin, profile=True))
    tell(report.summary(result))
    tell(profiled(result))
    tell([f"picture: {picture(result, options.output or Path(f'{options.file.stem}_profile.png'))}"])
    return report.exit_code(result.outcome)


def bench_command(arguments):
    from runtime.bench.command import main

    return main(arguments)


def doctor_command(arguments):
    from runtime.doctor.command import main

    return main(arguments)


def set_command(arguments):
    from runtime.live.command import set_live

    parser = Parser("set", "Change live parameters of a run that goes on, or list them. The exit code is 0 once the run has them.")
    parser.add_argument("pid", metavar="PID", help="process number of the run")
    parser.add_argument("settings", nargs="*", metavar="PATH=VALUE",
                        help="a live parameter: left/impedance.stiffness=40, wall.angle='60 deg'; @FILE reads such lines")
    options = parser.parse_args(arguments)
    if not options.pid.isdecimal():
        raise BadInput(f"set {options.pid}: expected the process number of a run, as in {program()} set 1234 left/impedance.stiffness=40")
    tell(set_live(int(options.pid), settings(options.settings, "")))
    return OK
