"""The command line: `python -m runtime FILE` runs a diagram; the other commands are listed in GROUPS."""

from __future__ import annotations

import errno
import gc
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.host import ending, installation_check
from runtime.host.console.terminal import exit_code, print_lines, print_to_stderr, short_program
from runtime.host.errors import BAD_INPUT, CHECK_FAILED, OK, BadInput
from runtime.host.suggestions import suggestion

if TYPE_CHECKING:
    from graph.diagnostics import DiagramError

GROUPS = {
    "run a robot": {
        "run": "run a diagram, in simulation or on a rig",
        "emulate": "emulate the devices of a diagram on a rig's real buses",
        "replay": "run a recording again, bit for bit or with a changed diagram",
        "study": "run a diagram for many values of its parameters, as one table",
        "optimise": "optimise live parameters while a wearer uses the robot",
        "set": "change live parameters of a run, or list them",
        "service": "print a systemd unit that starts a robot at boot",
    },
    "look at diagrams and recordings": {
        "new": "write a package for a laboratory's own robots and blocks",
        "check": "compile a diagram and report ports, schedule, proofs and buses",
        "analyse": "open a loop of a diagram and print its margins",
        "draw": "draw a diagram: SVG, PNG, Mermaid, an HTML page or URDF",
        "build": "compile your own native blocks",
        "blocks": "list the installed blocks, or describe one",
        "stubs": "write type stubs of your own blocks, for editors",
        "view": "open recordings in the browser, with marks, faults and strides",
        "plot": "plot signals of a recording, over time or over the gait cycle",
        "diff": "compare two recordings: a table and a picture",
        "convert": "write a recording as CSV, Parquet, MATLAB, Rerun or OpenSim",
        "plotjuggler": "write PlotJuggler's layout for a diagram, or send test data",
    },
    "set up hardware": {
        "doctor": "check whether this machine is fit to run a robot",
        "scan": "list the drives and sensors that respond; arms nothing",
        "configure": "set up a drive (id, zero, protocol, parameters) or a joint",
        "commission": "find what is wrong with each device, and record it",
        "calibrate": "find bias, offset and scale of an IMU",
        "move": "move one actuator within small limits",
        "stream": "show one drive live, without torque, or sensors",
    },
    "measure": {
        "profile": "run a diagram and print where the time of a tick goes",
        "rate": "find the highest rate at which actuators miss no reply",
        "soak": "run a rig at zero torque for hours, and report",
        "bench": "measure ticks, blocks and buses on this machine",
    },
}
COMMANDS = {name: text for group in GROUPS.values() for name, text in group.items()}
UNUSABLE_NAMES = (errno.EACCES, errno.ENAMETOOLONG, errno.ELOOP)  # errors of file names and their folders
LIMITS = (errno.EAGAIN, errno.EDQUOT, errno.EFBIG, errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ENOSPC)
NAME_LENGTH_SHOWN = 80  # characters of a file name in an error
MODULES = {"bench": "bench.command"}  # commands whose module has another name


def main(arguments: Sequence[str] | None = None, folder: str | None = None) -> int:
    """Run a command line. Returns the exit code.

    folder : the working folder, if `python -m` has put it on the path
    """
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    try:
        with ending.as_interrupt():
            check_encoding(arguments)
            code = command(arguments, folder)
    except BadInput as error:
        print_to_stderr([f"tickwork: {error}"])
        code = error.code
    except diagram_error() as error:
        count = len(error.diagnostics)
        print_to_stderr(
            [*map(str, error.diagnostics), f"tickwork: {count} error{'s' * (count > 1)}; nothing was armed"]
        )
        code = CHECK_FAILED
    except OSError as error:
        line = system_error(error)
        if line is None:
            raise
        print_to_stderr([f"tickwork: {line}"])
        code = BAD_INPUT
    except ImportError as error:
        print_to_stderr([f"tickwork: {installation_check.explain(error)}"])
        code = BAD_INPUT
    except MemoryError:
        print_to_stderr(["tickwork: out of memory: compare `ulimit -v` and `free`"])
        code = BAD_INPUT
    except ending.Interrupted as interrupt:
        ending.forget_interrupt()  # here, where it is not raised again
        print_to_stderr([f"tickwork: {ending.stopped_by(interrupt.number)}"])
        code = 128 + interrupt.number
    except KeyboardInterrupt:  # raised by user code: SIGINT raises Interrupted
        print_to_stderr(["tickwork: stopped by a KeyboardInterrupt in user code; nothing is armed"])
        code = 128 + signal.SIGINT
    ending.forget_interrupt()
    print_lines([])  # flush what the user's code has printed
    return exit_code(code)


def system_error(error: OSError) -> str | None:
    """Return the line on an OSError whose cause is the user's system; None for any other.

    The causes are a file name that the system refuses, a deleted working folder, and a limit (see `ulimit -a`).
    """
    name = "" if error.filename is None else f"{str(error.filename)[:NAME_LENGTH_SHOWN]}: "
    if error.errno in UNUSABLE_NAMES:
        return f"{name}{error.strerror}"
    if error.errno in LIMITS:
        return f"{name}{error.strerror}: a limit of the system was reached. Compare `ulimit -a` and `df`"
    if error.errno == errno.ENOENT and error.filename is None:
        return "the working folder was deleted: change to another folder"
    return None


def check_encoding(arguments: Sequence[str]) -> None:
    """Raise BadInput for an argument that is not valid UTF-8: file names and recordings cannot contain it."""
    for argument in arguments:
        if not argument.isascii() and any("\ud800" <= character <= "\udfff" for character in argument):
            shown = argument.encode(errors="surrogateescape").decode(errors="backslashreplace")
            raise BadInput(f"the argument '{shown}' is not valid UTF-8: retype it, or rename the file")


def diagram_error() -> type[DiagramError] | tuple[Any, ...]:
    """Return DiagramError, and () for commands that have not imported the compiler, which is half of a start."""
    graph = sys.modules.get("graph.diagnostics")
    return () if graph is None else graph.DiagramError


def command(arguments: Sequence[str], folder: str | None) -> int:
    """Run the command that the first argument names; any other first argument is the diagram file of `run`."""
    if arguments[:1] == ["--version"]:
        from importlib import metadata

        print_lines([f"tickwork {metadata.version('tickwork')}"])
        return OK
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        (print_lines if arguments else print_to_stderr)(usage())
        return OK if arguments else BAD_INPUT
    first = arguments[0]
    if first not in COMMANDS:
        is_word = first.isidentifier() and not Path(first).exists() and not Path(f"{first}.py").exists()
        if is_word and (suggestion(first, COMMANDS) or len(arguments) > 1):
            hint = suggestion(first, COMMANDS) or "the option --help lists the commands"
            raise BadInput(f"{first!r} is neither a command nor a file; {hint}")
        return run("run", arguments, folder)
    return run(first, arguments[1:], folder)


def run(name: str, arguments: Sequence[str], folder: str | None) -> int:
    """Import a command and run it. Returns the exit code.

    name : name of the command
    arguments : arguments after the name of the command
    folder : as in `main`
    """
    module = import_module(f"runtime.cli.{MODULES.get(name, name)}")
    if name != "run":  # which collects no garbage before its first tick, nor during its ticks
        gc.enable()
    problem = installation_check.namesake(folder)  # after the imports that this command needs
    if problem is not None:
        raise BadInput(problem)
    ending.raise_on_signals()
    return module.main(arguments)


def usage() -> list[str]:
    """Return the lines of the program's help."""
    name, width = short_program(), max(map(len, COMMANDS)) + 3
    lines = [f"usage: {name} FILE [OPTION...]", f"       {name} COMMAND [ARGUMENT...]", ""]
    lines.append("FILE, such as diagrams/knee_exo.py, is a diagram: FILE alone is `run FILE`.")
    for title, commands in GROUPS.items():
        lines += ["", title, *(f"  {command:<{width}}{text}" for command, text in commands.items())]
    return [*lines, "", "COMMAND --help lists the options of a command."]
