"""docs/rigs.md: its rig fits the knee exoskeleton, and it has every code of this room, each of which some test provokes."""

import re
from pathlib import Path

from runtime.diagram_file import load
from runtime.rig import CODES, read
from tests.runtime.runs import KNEE_EXO, ROOT

PAGE = (ROOT / "docs" / "rigs.md").read_text()


def test_the_rig_of_the_page_fits_the_knee_exoskeleton(tmp_path):
    path = tmp_path / "lab.toml"
    path.write_text(re.search(r"^```toml\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)[1])
    _, diagram = load(KNEE_EXO, (), read(path))
    knee = diagram["left/knee"]
    assert (knee.can_id, knee.invert, knee.offset) == (3, True, 0.12) and diagram["right/knee"].can_id == 2
    assert all(f"`{name}`" in PAGE for name in knee.hardware)


def test_every_code_has_its_row():
    assert dict(re.findall(r"^\| (TW\d+) \| ([^|]+?) \|", PAGE, re.MULTILINE)) == CODES


def test_every_code_is_raised_and_provoked():
    here = Path(__file__)
    raised = "".join(path.read_text() for path in (ROOT / "runtime" / "rig").glob("*.py") if path.name != "troubles.py")
    tests = [path for folder in (here.parent, ROOT / "tests" / "hardware") for path in folder.glob("*.py") if path != here]
    provoked = "".join(path.read_text() for path in tests)
    for text in (raised, provoked):
        assert {code for code in CODES if code in text} == set(CODES)
