"""Validation of a recording's metadata."""

import re
from typing import Any

from runtime.host.errors import BadInput
from runtime.record.storage.json_text import is_object

FORMATS = ("1", "2", "3")
LINE_BREAKING = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029]")  # in a name: would begin another line on a terminal


def validate(path: Any, about: Any) -> None:
    """Raise BadInput if the content of about.json does not describe the messages of a recording."""
    if is_object(about) and about.get("format") not in FORMATS:
        raise BadInput(
            f"{path} has format {about.get('format')!r}, and this Tickwork reads "
            f"{', '.join(FORMATS)}: "
            "pip install --upgrade tickwork"
        )
    if not describes_signals(about):
        raise BadInput(f"{path} is damaged: its about.json does not list the signals")


def describes_signals(about: Any) -> bool:
    """Return whether about.json has all fields that describe the messages."""
    try:
        texts = [
            about["name"],
            *about["buses"],
            *(signal[word] for signal in about["signals"] for word in ("path", "unit", "dtype")),
        ]
        return (
            all(isinstance(text, str) and not LINE_BREAKING.search(text) for text in texts)
            and all(type(signal.get("every", 1)) is int and signal.get("every", 1) > 0 for signal in about["signals"])
            and about["rate"] > 0
            and isinstance(about["metadata"], dict)
        )
    except (LookupError, TypeError, AttributeError):
        return False
