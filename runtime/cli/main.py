"""The command line: `python -m runtime FILE` runs a diagram; the other commands look at one, or at this machine."""

import signal
import sys
from importlib import import_module
from pathlib import Path

from runtime.base import installation_check
from runtime.base.errors import BAD_INPUT, CHECK_FAILED, OK, BadInput
from runtime.base.suggestions import suggestion
from runtime.console.terminal import complain, program, tell

COMMANDS = {
    "run": "run a diagram, in simulation or on a rig",
    "check": "compile a diagram and tell what was found: ports, schedule, proof, buses",
    "draw": "draw a diagram: SVG, PNG, Mermaid, or a page to explore",
    "emulate": "play the plant of a diagram on the real buses of a rig, for a robot in another terminal",
    "replay": "run a recording again, bit for bit, or through a changed diagram",
    "diff": "compare two recordings: a table and a picture",
    "convert": "write a recording as CSV, Parquet, MATLAB, Rerun or OpenSim",
    "plot": "draw signals of a recording, over time or over the gait cycle",
    "plotjuggler": "make PlotJuggler's layout for a diagram, or send it a stream to try the set-up with",
    "blocks": "list the blocks that are installed, or tell all about one",
    "profile": "run a diagram and tell where the time of a tick goes, block by block",
    "rate": "find the highest rate at which one to eight actuators miss no answer, simulated or on a rig",
    "bench": "measure ticks and blocks on this machine",
    "doctor": "look whether this machine is fit to run a robot, and what to change",
    "scan": "tell every drive and IMU that answers on a bus or a port; arms nothing",
    "configure": "set up a drive (id, zero, protocol, parameters), or find how a motor sits at its joint",
    "move": "move one actuator of a bus, within small limits",
    "stream": "show one drive live, without torque, or inertial sensors",
    "calibrate": "find bias, offset and scale of an IMU while somebody turns it, and keep them in a file",
    "set": "change live parameters of a run that goes on, or list them",
}
MODULES = {"bench": "bench.command"}  # of commands that are not one module of the same name


def main(arguments=None, folder=None):
    """Run a command line. Returns the exit code.

    folder : the working folder, where `python -m` has put it on the path
    """
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    DiagramError = ()
    try:
        DiagramError = refusal(arguments)
        check_encoding(arguments)
        code = command(arguments, folder)
    except BadInput as error:
        complain([f"tickwork: {error}"])
        code = error.code
    except DiagramError as error:
        count = len(error.diagnostics)
        complain([*map(str, error.diagnostics), f"tickwork: {count} error{'s' * (count > 1)}; nothing was armed"])
        code = CHECK_FAILED
    except KeyboardInterrupt as interrupt:
        number = getattr(interrupt, "number", signal.SIGINT)
        complain([f"tickwork: stopped by {signal_name(number)}; nothing is armed"])
        code = 128 + number
    tell([])  # what the user's own code has printed
    return code


def signal_name(number):
    """Return the name of a signal, or of the key that sends it."""
    return "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name


def check_encoding(arguments):
    """Raise BadInput for an argument that is not valid UTF-8: no file, title or recording could hold it."""
    for argument in arguments:
        if not argument.isascii() and any("\ud800" <= character <= "\udfff" for character in argument):
            shown = argument.encode(errors="surrogateescape").decode(errors="backslashreplace")
            raise BadInput(f"the argument '{shown}' is not valid UTF-8: retype it, or rename the file")


def refusal(arguments):
    """The exception of a diagram that is refused; nothing that could be raised where recordings are read: the language
    needs what was compiled.
    """
    if arguments and arguments[0] in installation_check.READING:
        return ()
    from graph import DiagramError

    return DiagramError


def command(arguments, folder):
    if not arguments or arguments[0] in ("-h", "--help"):
        (tell if arguments else complain)(usage())
        return OK if arguments else BAD_INPUT
    first = arguments[0]
    if first not in COMMANDS:
        if (
            not first.startswith("-")
            and not Path(first).suffix
            and not Path(first).exists()
            and suggestion(first, COMMANDS)
        ):
            raise BadInput(f"there is neither a command nor a file {first!r}; {suggestion(first, COMMANDS)}")
        return run("run", arguments, folder)
    return run(first, arguments[1:], folder)


def run(name, arguments, folder):
    module = import_module(f"runtime.cli.{MODULES.get(name, name)}")
    trouble = installation_check.namesake(folder)  # now that all is loaded that this command needs
    if trouble is not None:
        raise BadInput(trouble)
    return module.main(arguments)


def usage():
    lines = [f"usage: {program()} FILE [options]      run a diagram; FILE is Python, such as diagrams/knee_exo.py"]
    lines += [f"       {program()} {name:<10} ...      {text}" for name, text in COMMANDS.items() if name != "run"]
    lines.append(
        f"       {program()} COMMAND --help      the options of run, "
        f"{' and '.join(name for name in COMMANDS if name != 'run')}"
    )
    return lines
