"""JSON of an untrusted recording, with a limit on its depth."""

import json
from typing import Any, TypeGuard

DEPTH_LIMIT = 64  # levels of lists and objects


class TooDeep(ValueError):
    """JSON that is nested deeper than that of a recorder."""


def is_object(content: object) -> TypeGuard[dict[str, Any]]:
    """Return whether the content of a JSON text is an object."""
    return isinstance(content, dict)


def parsed_json(text: bytes | str) -> Any:
    """Return the content of a JSON text. Raises ValueError; TooDeep if it could not be processed recursively."""
    try:
        content = json.loads(text)
    except RecursionError:
        raise TooDeep from None
    layer = [content]
    for _ in range(DEPTH_LIMIT + 1):
        layer = [
            item
            for held in layer
            if isinstance(held, (dict, list))
            for item in (held.values() if isinstance(held, dict) else held)
        ]
        if not layer:
            return content
    raise TooDeep
