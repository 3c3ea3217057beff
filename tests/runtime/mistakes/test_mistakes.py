"""Mistakes of a diagram's author: each message names the line and the remedy, and the remedy works."""

import re
import sys

import pytest

from blocks.controllers import Impedance
from blocks.filters import Butterworth
from blocks.limiters import SlewRate
from graph import DiagramError
from graph.signal_misuse import NUMPY, OPERATORS
from runtime import check, load, optimise, run, study
from runtime.host.errors import BadInput
from tests.runtime.mistakes.in_attributes import ATTRIBUTES, VALUES
from tests.runtime.mistakes.in_blocks import BLOCKS
from tests.runtime.mistakes.in_diagrams import OPERATIONS, PARAMETERS, WIRES
from tests.runtime.mistakes.in_files import FILES, IMPORTS_AND_NAMES
from tests.runtime.mistakes.sources import COMMAND, LAW, diagram

DURATION = 0.02  # s
MISTAKES = (*OPERATIONS, *IMPORTS_AND_NAMES, *WIRES, *PARAMETERS, *FILES, *BLOCKS, *ATTRIBUTES, *VALUES)


@pytest.fixture
def diagram_file(tmp_path, monkeypatch):
    """Function that writes a diagram file and returns its path; its modules are forgotten after the test."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delitem(sys.modules, "knee", raising=False)

    def write(text):
        path = tmp_path / "knee.py"
        path.write_text(text)
        return path

    yield write
    sys.modules.pop("knee", None)


def report(path):
    """Return what is reported of a diagram file that does not run to its end."""
    try:
        trial = run(path, DURATION)
    except (BadInput, DiagramError) as error:
        return str(error)
    assert trial.fault is not None, "the file runs"
    return "\n".join(trial.fault["report"])


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.name)
def test_mistake_is_reported_with_its_line_and_a_remedy_that_works(mistake, diagram_file):
    said = report(diagram_file(mistake.wrong))
    position = 0
    for part in mistake.message:
        assert part in said[position:], said
        position = said.index(part, position)
    marked = [number for number, line in enumerate(mistake.wrong.splitlines(), 1) if line.endswith("# !")]
    assert all(f"knee.py:{number}" in said for number in marked), said
    assert run(diagram_file(mistake.right), DURATION).fault is None


def test_every_block_that_a_message_names_exists():
    remedies = [*(remedy for _, remedy in OPERATORS.values()), *NUMPY.values()]
    named = [
        (name, module)
        for remedy in remedies
        for names, module in re.findall(
            r"((?:[A-Z]\w+(?:\(\S+\))?(?:, | and | or |\b)?)+) \((?:both )?from (\S+?)\)", remedy
        )
        for name in re.findall(r"\b[A-Z]\w+", names)
    ]
    assert len(set(named)) > 15
    for name, module in named:
        __import__(module)
        assert hasattr(sys.modules[module], name), (name, module)


COMMANDS = {  # {command line: message}; R is a recording
    "start knee.py": "'start' is neither a command nor a file; the option --help lists the commands",
    "simulate knee.py": "'simulate' is neither a command nor a file; did you mean 'emulate'?",
    "kne.py": "file kne.py does not exist: did you mean 'knee.py'?",
    "knee": "file knee does not exist: did you mean 'knee.py'?",
    "notes.txt": "notes.txt is not a Python file: its name must end in .py",
    ".": ". is a folder: name a diagram file in it",
    "knee.py --fast": "--fast needs --duration S, as in --fast --duration 60",
    "knee.py --duration 10s": "--duration 10s: expected a number of seconds above 0",
    "knee.py --output out": "there is no option --output (",
    "knee.py --durration 1": "there is no option --durration; did you mean '--duration'?",
    "knee.py --set impedance.stifness=3": "impedance has no parameter 'stifness'; did you mean 'stiffness'?",
    "knee.py --set stiffness=3": "knee.py has no parameter 'stiffness'; did you mean 'impedance.stiffness'?",
    "knee.py --set impedance/stiffness=3": "did you mean 'impedance.stiffness'?",
    "knee.py --set impedance.stiffness": "expected NAME=VALUE, as in --set left/impedance.stiffness=40",
    "knee.py --set impedance.stiffness=soft": "stiffness: 'soft' is not a number",
    "knee.py --set impedance.stiffness=1e9": "stiffness: must be at most 150.0 N·m/rad",
    "knee.py --set impedance.stiffness=3,5": "'3,5' is not a number: write a decimal point, as in 2.5",
    "knee.py --trial subject": "--trial subject: expected NAME=VALUE, as in subject=S03",
    "knee.py --rig": "argument --rig: expected one argument",
    "knee.py --rig lap.toml": "lap.toml: error TW101 unreadable rig file: no such file\n    did you mean 'lab.toml'?",
    "knee.py 20": "unexpected argument '20': pass it as --duration 20",
    "knee.py knee.limit=3": "unexpected argument 'knee.limit=3': pass it as --set knee.limit=3",
    "knee.py lab.toml": "unexpected argument 'lab.toml': pass it as --rig lab.toml",
    "scan can0": "unexpected argument 'can0': pass it as --channel can0",
    "knee.py --rig twice.toml": "write each table and each key once",
    "check knee.py --rig degrees.toml": "must be within ±12.5 rad, the positions that the drive reports, got [0, 90]: "
    "if these are degrees, write [0, 1.571]",
    "study knee.py": "knee.py: expected the TOML file of a study, such as study.toml",
    "knee.py --rig lab.toml --fast --duration 1": "--fast and --rig exclude each other: a rig runs in real time",
    "knee.py --rig lab.toml": "[bus.leg] interfce: unknown key\n    did you mean 'interface'?",
    "knee.py --rig knee.py": "unreadable rig file: invalid TOML",
    "emulate knee.py": "missing argument --rig",
    "set impedance.stiffness=4": "expected the process number of a run, as in",
    "set 999999 impedance.stiffness=4": "process 999999 does not exist",
    "plot knee.py": "knee.py is not a recording of Tickwork: pass the .mcap file of the run",
    "plot missing.mcap": "missing.mcap: No such file or directory",
    "convert missing.mcap": "no format given: pass --to",
    "draw knee.py -o knee.bmp": "unknown format .bmp: use one of .svg, .png, .mmd, .html",
    "blocks TorqueLimit": "no installed block has the name 'TorqueLimit'; did you mean TorqueLimiter?",
    "blocks Kalman": "no installed block has the name 'Kalman'; list all blocks",
    "new My-Lab": "'My-Lab' cannot name a package: use lower-case letters, digits and _",
    "service knee.py": "a service needs --rig FILE and --arm-on SIGNAL",
}
CALLS = {  # {expression: message of its exception}
    'run("knee.py", "10")': "duration='10': expected a finite number above 0",
    'run("knee.py", 1.0, rate="200")': "rate='200': expected a finite number above 0",
    'run("knee.py", 1.0, settings="impedance.stiffness=3")': "expected a dict, as in",
    'run("knee.py", 1.0, settings=["impedance.stiffness"], fast=False)': "expected a dict, as in",
    'check("knee.py", settings=["impedance.stiffness"])': "expected a dict, as in",
    'study("knee.py", 1.0, {"x": len}, grid={"a": [1]}, settings=["stiffness"])': "expected a dict, as in",
    'run("knee.py", 1.0, settings={"impedance.stifness": 3})': "did you mean 'stiffness'?",
    'run("kneee.py", 1.0)': "file kneee.py does not exist: did you mean 'knee.py'?",
    'run(["knee.py"], 1.0)': "expected a Diagram, the path of a diagram file or a function that builds one",
    'study("knee.py", 1.0, ["peak"], grid={})': "objectives = ['peak']: expected named functions, as in",
    'study("knee.py", 1.0, {"x": len}, grid={"impedance.stiffness": 3.0})': "= 3.0: expected a list of numbers",
    'optimise("knee.py", 1.0, {"x": len}, over={"impedance.stiffness": 3.0})': "= 3.0: expected [LOW, HIGH]",
    'optimise("knee.py", 1.0, {"x": len}, over=["impedance.stiffness"])': "expected a table of settings",
    'load("missing.mcap")': "missing.mcap: No such file or directory",
    'load("notes.txt")': "notes.txt is not a recording of Tickwork",
    'load("trials/*.mcap")': "no such recording: trials/*.mcap",
    'trial["knee.postion"]': "has no signal 'knee.postion': did you mean 'knee.position'?",
    'trial["position"]': "did you mean 'knee.position'?",
    'trial["knee"]': "it is a block with the signals knee.active, knee.age",
    'trial["time"]': "it is the attribute time of the trial",
    "trial[0]": "a trial takes the path of one signal, as in trial['knee.position'], got 0",
    "trial[['knee.position']]": "a trial takes the path of one signal",
    "trial.knee": "it is a block with the signals knee.active",
    "trial.speed": "Read a signal as in trial['knee.position']",
    "trial.to_pandas()": "call trial.table() for a pandas.DataFrame",
    "trial.to_csv('a.csv')": "convert its file with `python -m runtime convert FILE --to csv`",
    "trial.error": "read trial.fault",
    "load(3)": "load(3): name a recording, a pattern, or several recordings",
    "load([1])": "load([1]): name a recording, a pattern, or several recordings",
    "load(b'x')": "load(b'x'): name a recording, a pattern, or several recordings",
    "Butterworth(2, 20.0).step(1.0)": "butterworth needs a sampling period",
    "slew.step(9.0)": "slew_rate needs a sampling period",
    "Impedance().step(1.0)": "Impedance takes position, velocity",
}


@pytest.fixture
def folder(tmp_path, command_line):
    """A folder with a diagram, a rig file with a mistake, and notes; the working folder."""
    (tmp_path / "knee.py").write_text(diagram(f"{LAW}\n{COMMAND}\nCsvRecorder()"))
    (tmp_path / "lab.toml").write_text('[bus.leg]\ninterfce = "socketcan"\nchannel = "can0"\n')
    can = '[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\n'
    (tmp_path / "degrees.toml").write_text(f"{can}[device.knee]\nrange = [0, 90]\n")
    (tmp_path / "twice.toml").write_text(can + can)
    (tmp_path / "notes.txt").write_text("notes\n")
    return tmp_path


def test_mistakes_on_the_command_line_are_reported(folder, command_line):
    for words, message in COMMANDS.items():
        assert message in command_line.refused(*words.split()), words


def test_mistakes_in_calls_are_reported(folder):
    slew = SlewRate(rate=3.0)
    slew.step(0.0)
    trial = run("knee.py", DURATION)
    names = {"Butterworth": Butterworth, "Impedance": Impedance, "load": load, "run": run, "slew": slew, "trial": trial}
    names |= {"optimise": optimise, "study": study, "check": check}
    for expression, message in CALLS.items():
        with pytest.raises((AttributeError, BadInput, KeyError, TypeError)) as raised:
            eval(expression, names)
        assert message in str(raised.value), expression
