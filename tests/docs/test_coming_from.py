"""Pages for users of other software: every diagram of Tickwork on them runs, and they describe one controller."""

import re

import numpy as np
import pytest

import runtime
from tests.checkout import ROOT

PAGES = [  # those about a package's interface and examples have tests of their own
    page
    for page in sorted((ROOT / "docs" / "coming_from").glob("*.md"))
    if not page.stem.startswith("epically_powerful_")
]


def diagrams(page):
    """Return the diagram of each Python sample. Samples of other software have the language `py`."""
    for sample in re.findall(r"^```python\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE):
        names = {"__name__": "sample"}
        exec(compile(sample, page.name, "exec"), names)
        yield names["diagram"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_diagrams_hold_the_joint_with_the_law_of_the_page(page):
    own = list(diagrams(page))
    assert own
    for diagram in own:
        trial = runtime.run(diagram, duration=6)
        assert trial.fault is None, (page, diagram.name)
        if diagram.name == "leg":
            assert np.isfinite(trial["shank.raw_euler[1]"]).all()  # a sensor alone
            continue
        position, velocity = trial["knee.position"], trial["knee.velocity"]
        if diagram.name != "hold":
            assert np.ptp(position) > 0.3  # the state machine swings the knee
            continue
        after = 200  # ticks, of the fade-in and of the first motion
        law = np.clip(20.0 * (0.3 - position) - velocity, -9.0, 9.0)
        assert trial["knee.torque"][after + 1 :] == pytest.approx(law[after:-1], abs=0.1)
        assert position[-1] == pytest.approx(0.3, abs=0.02)
