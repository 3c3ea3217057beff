"""Edits of a device's entry in a rig file that preserve the rest of the file, including comments."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from runtime.host import replaced_file
from runtime.host.errors import BadInput
from runtime.robot.rig.file import parse, read_text
from runtime.setup.commissioning.bus import plain, quoted

HEADER = re.compile(r"^\s*\[")


def change_device(path: str | Path, text: str, device: str, values: Mapping[str, Any]) -> str:
    """Return the text of a rig file with new values for a device.

    path : rig file named in messages
    text : present content
    device : path of the device
    values : {parameter: number, bool, text or list}

    Raises BadInput if the edit would change anything else in the file.
    """
    lines = text.split("\n")
    start = next((place for place, line in enumerate(lines) if header_of(line) == device), None)
    if start is None:
        while lines and not lines[-1].strip():
            lines.pop()
        lines += [""] * bool(lines) + [
            f"[device.{quoted(device)}]",
            *(f"{name} = {plain(value)}" for name, value in values.items()),
            "",
        ]
    else:
        end = next((place for place in range(start + 1, len(lines)) if HEADER.match(lines[place])), len(lines))
        last = max(
            place for place in range(start, end) if lines[place].strip() and not lines[place].lstrip().startswith("#")
        )
        new = []
        for name, value in values.items():
            pattern = re.compile(rf"^(\s*{re.escape(name)}\s*=\s*)([^#]*?)(\s*(?:#.*)?)$")
            matches = ((place, pattern.match(lines[place])) for place in range(start + 1, end))
            place, match = next(((place, match) for place, match in matches if match), (0, None))
            if match is None:
                new.append(f"{name} = {plain(value)}")
            else:
                lines[place] = f"{match[1]}{plain(value)}{match[3]}"
        lines[last + 1 : last + 1] = new
    result = "\n".join(lines)
    check(path, text, result, device, values)
    return result


def header_of(line: str) -> str | None:
    """Return the device whose table starts on a line, or None for another line."""
    match = re.fullmatch(r"""\s*\[\s*device\s*\.\s*(?:"([^"\\]*)"|'([^']*)'|([\w-]+))\s*\]\s*(?:#.*)?""", line)
    return next((name for name in match.groups() if name is not None), None) if match else None


def check(path: str | Path, before: str, after: str, device: str, values: Mapping[str, Any]) -> None:
    """Raise BadInput if the edit makes the file invalid or changes anything else in it."""
    old = parse(path, before)
    refusal = (
        f"{path}: the notation of [device.{quoted(device)}] cannot be edited automatically. Nothing was written. Edit "
        "the file by hand: "
    )
    assignments = ", ".join(f"{name} = {plain(value)}" for name, value in values.items())
    try:
        new = parse(path, after)
    except BadInput:
        raise BadInput(refusal + assignments) from None
    expected = dict(old.devices)
    expected[device] = {**old.devices.get(device, {}), **values}
    if new.buses != old.buses or new.devices != expected:
        raise BadInput(refusal + assignments)


def write(path: str | Path, before: str, text: str) -> None:
    """Replace a file atomically. Its owner, permissions and line ends stay, also under sudo.

    before : content that the file must still have

    Raises BadInput if it has changed since it was read or cannot be written.
    """
    path = Path(path)
    if read_text(path) != before:
        raise BadInput(f"{path} has changed since it was read; nothing was written. Run the command again")
    try:
        newline = "\r\n" if b"\r\n" in path.read_bytes() else "\n"
        replaced_file.write(path, text.replace("\n", newline))
    except OSError as error:
        raise BadInput(f"{path} cannot be written: {error.strerror}") from None
