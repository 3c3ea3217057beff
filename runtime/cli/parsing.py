"""Words of the command line: options that several commands have, and what their texts become. BadInput says in one line
what is wrong.
"""

import argparse
import math
import os
import re
from importlib.util import find_spec
from pathlib import Path

from runtime.base.errors import BadInput
from runtime.base.suggestions import suggestion
from runtime.console.terminal import program

LONGEST = 1e9  # s: 30 years


class Parser(argparse.ArgumentParser):
    """Wrong options raise BadInput, in one line. They are not completed: what is short for one today may be another's
    name tomorrow.
    """

    def __init__(self, name, description, epilog=None):
        super().__init__(
            prog=f"{program()} {name}",
            description=description,
            epilog=epilog,
            allow_abbrev=False,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        self.name = name

    def parse_args(self, arguments, mixed=False):
        """mixed : words may stand between and behind options"""
        options, unknown = (self.parse_known_intermixed_args if mixed else self.parse_known_args)(arguments)
        if unknown:
            self.error(self.explain(unknown[0]))
        return options

    def explain(self, word):
        if not word.startswith("-"):
            return f"{word!r} is one word too many"
        hint = suggestion(word.partition("=")[0], self._option_string_actions)
        return f"there is no option {word}" + (f"; {hint}" if hint else "")

    def error(self, message):
        if message.endswith("required: FILE"):
            message = "which file? name a diagram file, such as diagrams/knee_exo.py"
        elif "required: RECORDING" in message:
            message = (
                "which recording? name the .mcap file of a run, as in recordings/knee_exo_2026-11-21_10-00-00.mcap"
            )
        raise BadInput(f"{message} ({program()} {self.name} --help lists the options)")


def add_diagram(parser):
    """The diagram, and what changes it before it is compiled."""
    parser.add_argument("file", type=Path, metavar="FILE", help="a diagram file, such as diagrams/knee_exo.py")
    parser.add_argument(
        "--rate", type=number("--rate", "Hz"), metavar="HZ", help="ticks a second instead of the diagram's own"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        dest="settings",
        help="a parameter of build() or plant(), or of a block: left/impedance.stiffness=40, "
        "angle='60 deg'; "
        "@FILE reads such settings, one a line",
    )


def add_rig(parser):
    parser.add_argument(
        "--rig",
        type=Path,
        metavar="FILE",
        help="a rig file, such as lab.toml: the interface of each bus, and how this robot's devices are mounted",
    )


def add_bitrate(parser, help):
    parser.add_argument("--bitrate", type=number("--bitrate", "bit/s", 1e9), metavar="N", help=help)


def add_pace(parser):
    from runtime.report.timing import overrun_policy, spin_window

    parser.add_argument(
        "--overrun",
        type=overrun_policy,
        default="skip",
        metavar="POLICY",
        help="of a tick that comes too late: skip (default), catch-up:N ticks run late at most, "
        "fault:N missed in a row, "
        "fault:N/WINDOW; or several, with commas",
    )
    parser.add_argument(
        "--spin",
        type=spin_window,
        default=0.0,
        metavar="TIME",
        help="spin instead of sleeping this long before a deadline: 50us",
    )


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
    """Pairs (name, text) of NAME=VALUE words; @FILE stands for the lines of a file, in which `#` and a space begin a
    remark.
    """
    found = []
    for word in words:
        if not word.startswith("@"):
            found.append(setting(word, f"{option}{word}", option))
            continue
        try:
            lines = Path(word[1:]).expanduser().read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise BadInput(
                f"{option}{word}: cannot read the file: {getattr(error, 'strerror', None) or error}"
            ) from None
        found += [
            setting(line, f"{word[1:]}:{number}: {line}", option)
            for number, line in enumerate(map(str.strip, lines), 1)
            if line and line != "#" and not line.startswith("# ")
        ]
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


def rerun_target(text):
    from runtime.base.optional_dependencies import need
    from runtime.recorder.rerun.target import parse

    parse(text)
    if find_spec("rerun") is None:
        need("rerun", "--rerun")
    return text


def add_bus(parser):
    """Options that say which bus."""
    parser.add_argument("--rig", type=Path, metavar="FILE", help="a rig file, such as lab.toml: its buses")
    parser.add_argument("--bus", metavar="NAME", help="this bus of the rig alone")
    parser.add_argument(
        "--interface",
        metavar="KIND",
        help="instead of a rig: one of python-can's interfaces, such as socketcan or slcan; or i2c",
    )
    parser.add_argument("--channel", metavar="NAME", help="of the interface, such as can0, /dev/ttyACM0 or /dev/i2c-1")
    parser.add_argument(
        "--bitrate",
        type=count("--bitrate"),
        metavar="BPS",
        help="of the bus, in bit/s (default: the interface's own, or 1000000)",
    )
