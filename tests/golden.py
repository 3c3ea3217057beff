"""Whole pages that the program prints, in the files of tests/golden. `make golden` writes them: read what differs.

A test compares one with the fixture `golden`. What a page means is asserted by the tests beside it.
"""

import re
from pathlib import Path

FOLDER = Path(__file__).with_name("golden")
LIBRARY = Path(__file__).resolve().parents[1]


class Golden:
    """Compares pages with their files. rewrite : whether it writes the files instead"""

    def __init__(self, rewrite):
        self.rewrite = rewrite

    def __call__(self, name, page, **varying):
        """Assert that a page is that of its file.

        page : text, or its lines; varying : {name: pattern} of what differs from run to run
        """
        text = page if isinstance(page, str) else "".join(f"{line}\n" for line in page)
        for what, pattern in {"root": re.escape(f"{LIBRARY}/"), **varying}.items():
            text = re.sub(pattern, f"<{what}>", text)
        path = FOLDER / f"{name}.txt"
        if self.rewrite:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text)
        assert text == path.read_text(), "if the new page is right: make golden"
