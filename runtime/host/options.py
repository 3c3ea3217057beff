"""Options of the command line: a field of a dataclass that declares one, and converters of their texts.

A converter raises BadInput with one line that has the option, the text and what was expected.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import MISSING, field
from pathlib import Path
from typing import Any

from runtime.host.errors import BadInput

TIME_LIMIT = 1e9  # s: 30 years
RECORDING_SUFFIXES = (".csv", ".mcap", ".json")  # of the files of a recording


def option(
    *flags: str,
    default: Any = MISSING,
    collect: Callable[..., Any] | None = None,
    group: str | None = None,
    section: str | None = None,
    **argument: Any,
) -> Any:
    """Declare a field of a dataclass that is an option of the command line.

    flags : such as "--rate"; a positional argument has none
    default : default of the field and, where `collect` is None, of the option; a class, such as list, makes a new one
        each time
    collect : function from all texts of a repeated option to the value of the field
    group : name that options share which exclude each other
    section : title under which the help of `run` lists the option
    argument : arguments of ArgumentParser.add_argument: type, metavar, help and others
    """
    metadata = {"flags": flags, "collect": collect, "group": group, "section": section, "argument": argument}
    if isinstance(default, type):
        return field(default_factory=default, metadata=metadata)
    return field(default=default, metadata=metadata)


def subject_file(texts: Sequence[str]) -> Path | None:
    """Return the path of the subject file, None without one. Raises BadInput for two: the last would win."""
    if texts[1:]:
        raise BadInput(f"--subject was given twice, {' and '.join(texts)}: one file has the limits of a session")
    return Path(texts[0]) if texts else None


def number(option: str, unit: str, maximum: float = math.inf) -> Callable[[str], float]:
    """Return a converter of texts to numbers above 0. It raises BadInput.

    option : its name for messages
    unit : unit of the number
    maximum : largest number, in that unit
    """

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0.0 < value < math.inf:
            raise BadInput(f"{option} {text}: expected a number of {unit} above 0")
        if value > maximum:
            raise BadInput(f"{option} {text}: at most {maximum:g} {unit}")
        return value

    return parse


def finite(option: str, unit: str) -> Callable[[str], float]:
    """Return a converter of texts to finite numbers, which raises BadInput.

    option, unit : option and unit named in the message
    """

    def parse(text: str) -> float:
        try:
            number = float(text)
        except ValueError:
            number = float("nan")
        if not abs(number) < float("inf"):
            raise BadInput(f"{option} {text}: expected a number of {unit}")
        return number

    return parse


def whole_number(option: str, maximum: float = math.inf, minimum: int = 1) -> Callable[[str], int]:
    """Return a converter of texts to whole numbers from `minimum` to `maximum`. It raises BadInput.

    option : its name for messages
    """

    def parse(text: str) -> int:
        if not text.isdecimal() or int(text) < minimum:
            raise BadInput(f"{option} {text}: expected a whole number, {minimum} or more")
        if int(text) > maximum:
            raise BadInput(f"{option} {text}: at most {maximum}")
        return int(text)

    return parse


def processor(text: str) -> int:
    """Convert the text of `--cpu` to the number of a processor of this machine. Raises BadInput."""
    here = os.sysconf("SC_NPROCESSORS_CONF")
    if not text.isdecimal() or int(text) >= here:
        raise BadInput(f"--cpu {text}: expected the number of a processor; this machine has 0 to {here - 1}")
    return int(text)


def folder(text: str) -> Path:
    """Convert the text of `--record` to a path; a leading ~ is the home folder.

    Raises BadInput for an empty text, and for the name of a file of a recording.
    """
    if not text:
        raise BadInput("--record: expected a folder, got an empty text")
    path = Path(text).expanduser()
    if path.suffix in RECORDING_SUFFIXES and not path.is_dir():
        raise BadInput(f"--record {text}: expected a folder; the files in it have the name of the diagram")
    return path


def trial_fields(texts: Sequence[str]) -> dict[str, str]:
    """Return the fields of a trial as {name: value}. texts : such as "subject=S03"

    Raises BadInput for a text that is not NAME=VALUE, and for a name that is given twice.
    """
    fields: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not re.fullmatch(r"[^\W\d]\w*", name):
            raise BadInput(f"--trial {text}: expected NAME=VALUE, as in subject=S03")
        if name in fields:
            raise BadInput(f"--trial: {name} was given twice")
        fields[name] = value
    return fields


def pairs_of(given: Any) -> list[tuple[str, Any]]:
    """Return the pairs (name, value) of an argument `settings`, a dict or pairs. Raises BadInput for another form."""
    pairs: list[Any] = list(given.items() if hasattr(given, "items") else given or ())
    if not all(isinstance(pair, (tuple, list)) for pair in pairs) or any(
        len(pair) != 2 or not isinstance(pair[0], str) for pair in pairs
    ):
        raise BadInput(f'settings={given!r}: expected a dict, as in {{"left/impedance.stiffness": 40}}')
    return pairs


def settings(words: Sequence[str], option: str = "--set ") -> list[tuple[str, str]]:
    """Return the pairs (name, value) of NAME=VALUE words, as texts.

    @FILE reads the lines of a file; a line that starts with `#` and a space is a comment.

    option : its name for messages, with a space behind it

    Raises BadInput for an unreadable file or a word of another form.
    """
    pairs: list[tuple[str, str]] = []
    for word in words:
        if not word.startswith("@"):
            pairs.append(_setting(word, f"{option}{word}", option))
            continue
        from cext.user_files import read_small  # compiled, which a recording is read without

        try:
            lines = read_small(Path(word[1:]).expanduser()).decode("utf-8-sig").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise BadInput(
                f"{option}{word}: cannot read the file: {getattr(error, 'strerror', None) or error}"
            ) from None
        pairs += [
            _setting(line, f"{word[1:]}:{number}: {line}", option)
            for number, line in enumerate(map(str.strip, lines), 1)
            if line and line != "#" and not line.startswith("# ")
        ]
    return pairs


def _setting(text: str, shown: str, option: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise BadInput(f"{shown}: expected NAME=VALUE, as in {option}left/impedance.stiffness=40")
    return name.strip(), value.strip()


def panel_address(text: str) -> tuple[str, int]:
    """Convert the text of `--panel` to (host, port): 127.0.0.1 and 0 by default. Raises BadInput."""
    bare = text.endswith("]") or (text.count(":") > 1 and not text.startswith("["))  # an IPv6 address without a port
    host, colon, port = (text, "", "") if bare else text.rpartition(":")
    if not colon:
        host, port = ("", text) if text.isdecimal() else (text, "0")
    port = port or "0"
    if not port.isdecimal() or int(port) > 65535:
        raise BadInput(f"--panel {text}: expected ADDRESS:PORT, as in 192.168.1.5:8470")
    return host.strip("[]") or "127.0.0.1", int(port)


def host_and_port(text: str) -> tuple[str, int]:
    """Convert the text of `--plotjuggler` to (host, port); port 9870 by default. Raises BadInput."""
    host, colon, port = text.rpartition(":")
    if not colon:
        host, port = text, "9870"
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise BadInput(f"--plotjuggler {text}: expected HOST:PORT, as in 127.0.0.1:9870")
    return host.strip("[]"), int(port)
