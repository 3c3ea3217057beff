"""docs/reference/errors.md: every code of the compiler has an example that provokes it, and each is compiled here."""

import re
import textwrap
from pathlib import Path

import pytest

from graph import Diagram, DiagramError, compile, jit
from graph.diagnostics import CODES

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "errors.md").read_text()
PRELUDE = re.search(r"```python\n(from .*?)\n\nwith Diagram", PAGE, re.S)[1]
EXAMPLES = dict(re.findall(r"^## (TW\d{3})[^\n]*\n\n```python\n(.*?)```", PAGE, re.S | re.M))


def test_every_code_is_on_the_page_with_its_title():
    for code, title in CODES.items():
        assert re.search(rf"^## {code} {title}", PAGE, re.M) or re.search(rf"{code}[,:]", PAGE), code
    assert set(EXAMPLES) | {"TW030", "TW031", "TW032"} == set(CODES)


@pytest.mark.parametrize("code", EXAMPLES)
def test_each_example_provokes_its_code(code, monkeypatch):
    if code == "TW017" and not jit.available():
        pytest.skip("needs Numba, the extra `jit`")
    if code == "TW023":
        monkeypatch.setattr(jit, "available", lambda: False)
    lines = [
        *PRELUDE.splitlines(),
        "with Diagram('robot', rate=200) as diagram:",
        textwrap.indent(EXAMPLES[code], "    "),
    ]
    namespace = {"__name__": "example"}
    try:
        exec("\n".join(lines), namespace)
        diagram = namespace["diagram"]
        assert isinstance(diagram, Diagram)
        found = [warning.code for warning in compile(diagram).warnings]
    except DiagramError as error:
        found = [diagnostic.code for diagnostic in error.diagnostics]
    assert code in found
    assert set(found) <= {code, "TW020"}
