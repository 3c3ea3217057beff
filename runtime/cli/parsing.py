"""The parser of the command line, and options that several commands have."""

from __future__ import annotations

import argparse
import math
import re
import textwrap
from collections.abc import Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from runtime.host.console.terminal import exit_code, print_lines, program, short_program
from runtime.host.errors import BadInput
from runtime.host.options import number, whole_number
from runtime.host.suggestions import unknown_option

if TYPE_CHECKING:
    from argparse import Namespace

    from runtime.session.request import Request


class HelpFormatter(argparse.RawDescriptionHelpFormatter):
    """Formatter that wraps paragraphs and keeps tables and examples, whose lines have two spaces in a row."""

    def _fill_text(self, text, width, indent):
        return "\n\n".join(
            paragraph if "  " in paragraph else textwrap.fill(paragraph, width, break_on_hyphens=False)
            for paragraph in text.rstrip().split("\n\n")
        )


OPTION_OF = (  # (form of a word, option that it may belong to)
    (r".*\.toml", "--rig"),
    (r"v?can\d.*", "--channel"),
    (r"\d+\.?\d*", "--duration"),
    (r"[^=]+=.+", "--set"),
)


class Parser(argparse.ArgumentParser):
    """A parser whose errors are BadInput, in one line.

    An abbreviated option is an error: it may become the name of another one.
    """

    def __init__(self, name: str, description, epilog: str | None = None) -> None:
        super().__init__(
            prog=f"{short_program()} {name}",
            description=description,
            epilog=epilog,
            allow_abbrev=False,
            formatter_class=HelpFormatter,
        )
        self.name = name
        self.collected = {}  # {name of an option: function from its texts to its value}
        self.groups: dict[str, Any] = {}
        self.sections: dict[str | None, Any] = {None: self}

    def section(self, title: str | None) -> Any:
        """Return the group of options that the help lists under a title; the parser for None."""
        if title not in self.sections:
            self.sections[title] = self.add_argument_group(title)
        return self.sections[title]

    def group(self, name: str, section: str | None = None) -> Any:
        """Return the group of options that exclude each other under this name, in a section."""
        if name not in self.groups:
            self.groups[name] = self.section(section).add_mutually_exclusive_group()
        return self.groups[name]

    def parse_args(self, arguments: Sequence[str], mixed: bool = False) -> Namespace:
        """Parse arguments. mixed : allow positional arguments between and after options"""
        options, unknown = (self.parse_known_intermixed_args if mixed else self.parse_known_args)(arguments)
        if unknown:
            self.error(self.explain(unknown[0]))
        for name, collect in self.collected.items():
            setattr(options, name, collect(getattr(options, name) or []))
        return options

    def explain(self, word: str) -> str:
        """Return the error message for an unknown argument."""
        if not word.startswith("-"):
            option = next((option for form, option in OPTION_OF if re.fullmatch(form, word)), "")
            remedy = f": pass it as {option} {word}" if option in self._option_string_actions else ""
            return f"unexpected argument {word!r}{remedy}"
        return unknown_option(word, self._option_string_actions)

    def print_help(self, file: Any = None) -> None:
        """Write the help to standard output. file : ignored"""
        print_lines(self.format_help().splitlines())

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        """End the program after its help. message : never given"""
        raise SystemExit(exit_code(status))

    def error(self, message: str) -> NoReturn:
        """Raise BadInput with the message of argparse, or a clearer one where a file is missing."""
        if message.endswith("required: FILE"):
            message = "no diagram file given: pass one, such as diagrams/knee_exo.py"
        elif "required: RECORDING" in message:
            message = (
                "no recording given: pass the .mcap file of a run, such as recordings/knee_exo_2026-11-21_10-00-00.mcap"
            )
        elif "arguments are required: " in message:
            message = f"missing argument {message.rpartition('required: ')[2].partition(',')[0]}"
        raise BadInput(f"{message} ({program()} {self.name} --help lists the options)")


def add_number(
    to: Any, flag: str, unit: str, metavar: str, text: str, default: float | None = None, maximum: float = math.inf
) -> None:
    """Add an option whose value is a number above 0. text : help, to which the default is added

    to : Parser, or a group of its options
    """
    text += "" if default is None else f" (default: {default:g})"
    to.add_argument(flag, type=number(flag, unit, maximum), default=default, metavar=metavar, help=text)


def add_count(
    to: Any, flag: str, text: str, default: int | None = None, maximum: float = math.inf, minimum: int = 1
) -> None:
    """Add an option whose value is a whole number. Arguments as for `add_number`."""
    text += "" if default is None else f" (default: {default})"
    to.add_argument(flag, type=whole_number(flag, maximum, minimum), default=default, metavar="N", help=text)


def add_options(parser: Parser, kind: type[Any], *names: str, in_sections: bool = False, **changes: Any) -> None:
    """Add options that the fields of a dataclass declare with runtime.host.options.option.

    names : names of the fields
    in_sections : whether the help lists the options by section
    changes : {name: arguments of add_argument that differ here}
    """
    for name in names:
        declared = kind.__dataclass_fields__[name]
        flags, collect, group, argument = (declared.metadata[key] for key in ("flags", "collect", "group", "argument"))
        section = declared.metadata["section"] if in_sections else None
        if collect is not None:
            parser.collected[name] = collect
        if flags and declared.default is not MISSING and argument.get("action") != "store_true":
            argument = {"default": declared.default, **argument}
        if flags:
            argument = {"dest": name, **argument}
        adder = parser.group(group, section) if group else parser.section(section)
        adder.add_argument(*(flags or [name]), **{**argument, **changes.get(name, {})})


def fields_of(kind: type[Any]) -> list[str]:
    """Names of all fields that are options."""
    return [field.name for field in fields(kind) if field.metadata]


def instance(kind: type[Request], options: Namespace, **more: Any) -> Request:
    """Return a dataclass made from parsed options. more : values of fields, before those of the options"""
    known = kind.__dataclass_fields__
    return kind(**{**{name: value for name, value in vars(options).items() if name in known}, **more})


def add_bus(parser: Parser) -> None:
    """Add the options that select a bus."""
    bus = parser.section("bus")
    bus.add_argument("--rig", type=Path, metavar="FILE", help="select the buses of a rig file, such as lab.toml")
    bus.add_argument("--bus", metavar="NAME", help="select one bus of the rig")
    bus.add_argument(
        "--interface",
        metavar="KIND",
        help="without a rig: an interface of python-can, such as socketcan or slcan; or i2c",
    )
    bus.add_argument(
        "--channel", metavar="NAME", help="channel of the interface, such as can0, /dev/ttyACM0 or /dev/i2c-1"
    )
    bus.add_argument(
        "--bitrate",
        type=whole_number("--bitrate"),
        metavar="BPS",
        help="bitrate of the bus in bit/s (default: the present bitrate of the interface, or 1000000)",
    )
