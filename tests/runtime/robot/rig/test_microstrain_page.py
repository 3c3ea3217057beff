"""The diagram and the rig of MicroStrain sensors in docs/reference/imus.md run, and its tables are complete."""

import re
from pathlib import Path

from blocks.imus import EmulatedMicroStrain, MicroStrain
from blocks.imus.microstrain.models import MODELS
from runtime.host.errors import OK
from runtime.robot.rig.file import parse
from runtime.robot.rig.overrides import override
from tests.runtime.runs import ROOT, finished, write

PAGE = (ROOT / "docs" / "reference" / "imus.md").read_text()
MICROSTRAIN = PAGE[PAGE.index("## MicroStrain") :].split("\n## ")[0]


def fenced(kind):
    return re.findall(rf"^```{kind}\n(.*?)^```", MICROSTRAIN, re.DOTALL | re.MULTILINE)


def test_the_diagram_of_the_page_runs_and_its_rig_fits(tmp_path):
    source, rig = fenced("python")[0], fenced("toml")[0]
    write(tmp_path, source, "walker.py")
    run = finished("walker.py", "--fast", "--duration", "0.5", "--record", "out", cwd=tmp_path)
    assert run.returncode == OK, run.stderr
    names = {}
    exec(source, names)
    override(parse(Path("lab.toml"), rig), names["diagram"])
    assert names["diagram"]["thigh"].baudrate == 921600


def test_every_parameter_and_fault_is_documented():
    untold = {"bus"}
    assert [name for name in MicroStrain.parameters if name not in untold and f"`{name}`" not in MICROSTRAIN] == []
    assert [name for name in MicroStrain.outputs if f"`{name}`" not in PAGE] == []
    assert [name for name in EmulatedMicroStrain.inputs if f"`{name}`" not in MICROSTRAIN] == []
    assert [name for name in MODELS if name not in MICROSTRAIN] == []
