"""The command lines of pages, parsed by the parser of their command, which runs nothing."""

import re
import shlex
from unittest import mock

from runtime.cli.main import command
from runtime.cli.parsing import Parser
from runtime.host.errors import BadInput

LINE = re.compile(r"python -m runtime ((?:[^`\n\\]|\\\n)*)")
INCOMPLETE = ("missing argument", "no diagram file", "no recording", "one of the arguments", "expected stream")


class Parsed(Exception):
    """The parser has accepted the arguments. parser : parser of the command"""

    def __init__(self, parser):
        super().__init__()
        self.parser = parser


def words(line):
    """Return the words of a command line up to its end, a pipe or a comment."""
    line = re.split(r"\s(?:\||>|#|&&|;)|\s{3,}", line.replace("\\\n", " "))[0]
    try:
        return shlex.split(line)
    except ValueError:  # a quotation that goes on in the next line
        return line.split()


def refusal(arguments):
    """Return why the parser refuses arguments, or "". Accepts those that lack only a required one."""
    return _parsed(arguments, Parser.parse_args)[1]


def parser_of(arguments):
    """Return the parser of a command, which does not parse."""
    return _parsed(arguments, lambda *anything, **options: None)[0]


def _parsed(arguments, parse):
    """Run a command up to its parser. Returns (parser, why it refuses the arguments or "")."""

    def stop(parser, *words, **options):
        parse(parser, *words, **options)
        raise Parsed(parser)

    try:
        with mock.patch.object(Parser, "parse_args", stop):
            command(["file.py" if word == "FILE" else word for word in arguments], None)
    except Parsed as parsed:
        return parsed.parser, ""
    except BadInput as error:
        return None, "" if str(error).startswith(INCOMPLETE) else str(error)
    return None, ""
