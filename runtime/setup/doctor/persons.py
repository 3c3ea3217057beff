"""Removal of persons, accounts and computers from the texts of an archive: `doctor --bundle`."""

from __future__ import annotations

import getpass
import json
import os
import platform
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from typing import Any

KEYS = ("trial", "subject", "notes", "note", "operator", "node", "folder", "text")  # whose values are removed
OTHERS = "REMOVED"
SHORTEST = 3  # characters of a value that is looked for in other texts, and not only in names of files
NUMBER = re.compile(r"[-+]?[\d.,]+")
HOMES = re.compile(r"/(?:home|Users)/([^/\s\"':,;)]+)")
TOML_COMMENT = re.compile(
    r"(\"\"\"(?:\\.|[^\\])*?\"\"\"|'''.*?'''|\"(?:\\.|[^\"\\\n])*\"|'[^'\n]*')|[ \t]*#[^\n]*", re.DOTALL
)


class Persons:
    """What names the wearer, the operator, accounts and computers in the texts of one recording.

    about : metadata of the recording; names : of blocks, ports and buses, which stay

    removed : what `without_fields` has removed, as text
    """

    def __init__(self, about: Mapping[str, Any], names: Iterable[str]) -> None:
        self.removed: list[str] = []
        stay = {part.casefold() for name in names for part in re.split(r"[/.]", name)}
        self.patterns: dict[str, str] = {}
        metadata = about.get("metadata") or {}
        subject = metadata.get("subject") or {}
        fields = {**(metadata.get("trial") or {}), "id": subject.get("id"), "file": subject.get("file")}
        for word in words_of(str(value) for value in fields.values() if value):
            if len(word) < SHORTEST or NUMBER.fullmatch(word) or word.casefold() in stay:
                self.patterns[rf"(?<=_){re.escape(word)}(?=_)|(?<=/){re.escape(word)}(?=/)"] = OTHERS  # in a path
            else:
                self.patterns[rf"(?<![A-Za-z0-9])(?i:{re.escape(word)})(?![A-Za-z0-9])"] = OTHERS
        nodes = {platform.node(), str((about.get("machine") or {}).get("node") or "")}
        users = {*HOMES.findall(json.dumps(about, default=str))}
        with suppress(KeyError, OSError):  # an account without a name
            users |= {getpass.getuser(), os.environ.get("SUDO_USER") or "root"}
        for word in ({*nodes, *(node.partition(".")[0] for node in nodes)} - {"", "localhost"}) - stay:
            self.patterns[rf"(?<![A-Za-z0-9]){re.escape(word)}(?![A-Za-z0-9])"] = "HOST"
        for word in users - {"root"} - stay:
            if len(word) >= SHORTEST:
                self.patterns[rf"(?<![A-Za-z0-9]){re.escape(word)}(?![A-Za-z0-9])"] = "USER"
        self.patterns = dict(sorted(self.patterns.items(), key=lambda item: -len(item[0])))
        if subject.get("id"):  # before its parts: as in the lines on its limits, and in a fault
            named = rf"{re.escape(subject['id'])} \({re.escape(str(subject.get('file')))}\)"
            self.patterns = {named: OTHERS, **self.patterns}

    def scrub(self, text: str) -> str:
        """Return a text without names of persons, computers and homes."""
        home = os.path.expanduser("~")
        if len(home) > 1:
            text = text.replace(home + "/", "~/")
        text = HOMES.sub("~", text)
        for pattern, instead in self.patterns.items():
            text = re.sub(pattern, instead, text)
        return text

    def scrubbed(self, value: Any) -> Any:
        """Return a value of JSON whose texts are scrubbed; its numbers stay, whatever a field of the trial was."""
        if isinstance(value, Mapping):
            return {self.scrub(str(key)): self.scrubbed(each) for key, each in value.items()}
        if isinstance(value, (list, tuple)):
            return [self.scrubbed(each) for each in value]
        return self.scrub(value) if isinstance(value, str) else value

    def without_fields(self, value: Any, where: str = "") -> Any:
        """Return a value of JSON without the keys that are about persons, each of which is noted."""
        if isinstance(value, Mapping):
            kept = {}
            for key, each in value.items():
                place = f"{where}.{key}".lstrip(".")
                if key in KEYS and isinstance(each, (str, Mapping)) and each:
                    if key == "subject" and isinstance(each, Mapping):  # the limits of a subject file stay
                        each = {name: part for name, part in each.items() if name not in ("id", "file")}
                        kept[key], place = each, f"{place}.id"
                    self.removed += [place] * (place not in self.removed)
                else:
                    kept[key] = self.without_fields(each, place)
            return kept
        return [self.without_fields(each, where) for each in value] if isinstance(value, list) else value

    def without_comments(self, toml: str, name: str) -> str:
        """Return TOML without its comments, and note it. name : of the file"""
        kept = TOML_COMMENT.sub(lambda found: found[1] or "", toml)
        self.removed += [f"{name}: comments"] * (kept != toml)
        return kept


def words_of(values: Iterable[str]) -> Iterator[str]:
    """Yield values, as they are in names of files, and each word of what may be the name of an operator."""
    for value in values:
        yield value
        yield re.sub(r"[^\w.-]+", "-", value)
        words = re.split(r"[^\w.]+", value)
        if words[1:] and all(word[:1].isupper() for word in words):
            yield from (word for word in words if len(word) >= SHORTEST)
