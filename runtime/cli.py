"""The command line: `python -m runtime FILE` runs a diagram; the other commands look at one, or at this machine."""

import argparse
import math
import os
import sys
from pathlib import Path

from runtime.errors import BAD_INPUT, CHECK_FAILED, BadInput

COMMANDS = {
    "run": "run a diagram, in simulation",
    "check": "compile a diagram and tell what was found: ports, schedule, proof, buses",
    "draw": "draw a diagram: SVG, PNG, Mermaid, or a page to explore",
    "blocks": "list the blocks that are installed, or tell all about one",
    "bench": "measure ticks and blocks on this machine",
}


def main(arguments=None):
    """Run a command line. Returns the exit code."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    from graph import DiagramError

    try:
        if not arguments or arguments[0] in ("-h", "--help"):
            print(usage())
            return 0 if arguments else BAD_INPUT
        command = arguments.pop(0) if arguments[0] in COMMANDS else "run"
        return ROUTES[command](arguments)
    except BadInput as error:
        print(f"tickwork: {error}", file=sys.stderr)
        return error.code
    except DiagramError as error:
        for diagnostic in error.diagnostics:
            print(diagnostic, file=sys.stderr)
        count = len(error.diagnostics)
        print(f"tickwork: {count} error{'s' * (count > 1)}; nothing was armed", file=sys.stderr)
        return CHECK_FAILED
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        return 130


def usage():
    lines = ["usage: python -m runtime FILE [options]      run a diagram; FILE is Python, such as diagrams/knee_exo.py"]
    lines += [f"       python -m runtime {name:<10} ...      {text}" for name, text in COMMANDS.items() if name != "run"]
    lines.append("options of a run: python -m runtime run --help")
    return "\n".join(lines)


class Parser(argparse.ArgumentParser):
    verbatim = argparse.RawDescriptionHelpFormatter

    def error(self, message):
        raise BadInput(f"{message} (python -m runtime {self.prog.split()[-1]} --help lists the options)")


def run_command(arguments):
    from runtime import report
    from runtime.recorder import RecorderError
    from runtime.run import run

    request = parse_run(arguments)
    try:
        result = run(request)
    except RecorderError as error:
        raise BadInput(str(error)) from None
    if result.outcome.faulted:
        print("\n".join(report.fault(result)), file=sys.stderr)
    elif result.outcome.signal:
        print(f"stopped by {report.signal_name(result.outcome.signal)}", file=sys.stderr)
    print("\n".join(report.summary(result)))
    if not result.outcome.faulted:
        print("\n".join(report.hints(result)))
    return report.exit_code(result.outcome)


def parse_run(arguments):
    """Command-line words to a Request. BadInput says which is wrong."""
    from runtime.run import Request

    parser = Parser(prog="python -m runtime run", description="Run a diagram in simulation.")
    parser.add_argument("file", type=Path, help="a diagram file, such as diagrams/knee_exo.py")
    parser.add_argument("--rate", type=positive("--rate", "Hz"), metavar="HZ", help="ticks a second instead of the diagram's own")
    parser.add_argument("--duration", type=positive("--duration", "s"), metavar="S", help="stop after S seconds (default: Ctrl-C)")
    parser.add_argument("--fast", action="store_true", help="virtual time: as fast as the machine can (needs --duration)")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", dest="settings",
                        help="a parameter of build() or plant(), or of a block: left/impedance.stiffness=40, angle='60 deg'")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--record", type=Path, metavar="DIR", help="folder of the recording (default: recordings)")
    where.add_argument("--no-record", action="store_true", help="write no files")
    parser.add_argument("--plotjuggler", type=host_and_port, metavar="HOST:PORT", help="where PlotJuggler listens")
    options = parser.parse_args(arguments)
    if options.fast and options.duration is None:
        raise BadInput("--fast needs --duration S: virtual time has no Ctrl-C worth waiting for")
    return Request(
        file=options.file, rate=options.rate, duration=options.duration, fast=options.fast, settings=[setting(s) for s in options.settings],
        record=options.record, no_record=options.no_record, plotjuggler=options.plotjuggler)


def positive(option, unit):
    def parse(text):
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0.0 < value < math.inf:
            raise BadInput(f"{option} {text}: expected a number of {unit} above 0")
        return value

    return parse


def setting(text):
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise BadInput(f"--set {text}: expected NAME=VALUE, as in --set left/impedance.stiffness=40")
    return name.strip(), value.strip()


def host_and_port(text):
    host, colon, port = text.rpartition(":")
    if not colon:
        host, port = text, "9870"
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise BadInput(f"--plotjuggler {text}: expected HOST:PORT, as in 127.0.0.1:9870")
    return host.strip("[]"), int(port)


def check_command(arguments):
    from runtime.check import check_command

    return check_command(arguments)


def draw_command(arguments):
    from runtime.draw import draw_command

    return draw_command(arguments)


def blocks_command(arguments):
    from runtime.catalog import blocks_command

    return blocks_command(arguments)


def bench_command(arguments):
    from runtime.bench import bench

    parser = Parser(prog="python -m runtime bench", description="Measure ticks and blocks on this machine.")
    parser.add_argument("--seconds", type=positive("--seconds", "s"), default=0.2, metavar="S", help="of each measurement (default 0.2)")
    parser.add_argument("--repeats", type=int, default=9, metavar="N", help="measurements of each row (default 9)")
    options = parser.parse_args(arguments)
    bench(options.seconds, max(1, options.repeats))
    return 0


ROUTES = {"run": run_command, "check": check_command, "draw": draw_command, "blocks": blocks_command, "bench": bench_command}
