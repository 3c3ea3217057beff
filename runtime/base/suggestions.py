"""What somebody may have meant. Imports nothing of the language (graph.block has the same for it), so that it is there
where nothing was compiled.
"""

import difflib


def suggestion(word, known):
    """'did you mean ...?' for a misspelt word, or ''."""
    near = difflib.get_close_matches(str(word), list(known), n=1)
    return f"did you mean {near[0]!r}?" if near else ""
