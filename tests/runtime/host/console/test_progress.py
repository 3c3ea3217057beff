"""Progress of a long operation below the cell of a notebook."""

import IPython.display

from runtime.host.console import progress
from runtime.host.console.cell import Cell


class Handle:
    """What IPython.display.display returns; it keeps the texts."""

    def __init__(self):
        self.texts = []

    def update(self, content, raw):
        assert raw
        self.texts.append(content["text/plain"])


def test_progress_below_a_cell_replaces_its_line_and_empties_it_at_the_end(monkeypatch):
    handle = Handle()

    def display(content, raw, display_id):
        assert display_id is True
        handle.update(content, raw)
        return handle

    monkeypatch.setattr(IPython.display, "display", display)
    monkeypatch.setattr(progress, "in_cell", lambda: True)
    seconds = iter([0.0, 0.5, 2.0, 3.0])
    with progress.Progress("running 4 trials", clock=lambda: next(seconds)) as shown:
        for share in (0.25, 0.5, 0.75):
            shown(share)
    assert isinstance(shown.terminal, Cell)
    half, more, end = handle.texts
    assert half.startswith("running 4 trials ") and half.endswith(" 50 %, 2 s left")
    assert more.endswith(" 75 %, 1 s left") and end == ""
