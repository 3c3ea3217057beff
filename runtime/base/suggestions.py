"""Suggestions for misspelt words.

Imports nothing of graph, whose graph.names has the same function, so that it works without compiled modules.
"""

import difflib


def suggestion(word: str, known) -> str:
    """Return 'did you mean ...?' for a misspelt word, or ''."""
    near = difflib.get_close_matches(str(word), list(known), n=1)
    return f"did you mean {near[0]!r}?" if near else ""
