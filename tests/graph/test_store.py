"""Diagrams as JSON and back, and their content hash."""

import builtins
import inspect
import json
import linecache
import math
import sys
from importlib import import_module

import numpy as np
import pytest

from blocks.actuators import CubeMars
from blocks.controllers import Impedance, TorqueProfile
from blocks.discrete import UnitDelay
from blocks.limiters import TorqueLimiter
from blocks.mathematics import Gain, Sum
from blocks.recorders import CsvRecorder
from blocks.sources import Playback, StepSource
from blocks.states import StateMachine
from graph import Block, Diagram, DiagramError, Input, Live, Output, compile, subsystem
from graph.store import ENTRY_POINTS, content_hash, from_json, registered, source_text, to_json


class Local(Block):
    """A block of this file."""

    u = Input("any")
    y = Output("any")

    def step(self, u):
        return u


def knee(stiffness=30.0, reverse=False, rate=200):
    with Diagram("knee", rate=rate) as diagram:
        parts = [left, tail]
        for part in reversed(parts) if reverse else parts:
            part(stiffness)
        CsvRecorder()
    return diagram


def left(stiffness):
    with subsystem("left", every=1):
        drive = CubeMars("AK80-9", bus="legs", can_id=3, invert=True, name="knee")
        torque = Impedance(stiffness=stiffness)(position=drive.position, velocity=drive.velocity)
        drive(torque_command=TorqueLimiter(limit=Live(8.0, max=9.0, slew=2.0))(torque))


def tail(stiffness):
    with subsystem("slow", every=2, enabled=StepSource(name="gate", every=2)()):
        TorqueProfile(((0.1, 0.0), (0.5, 3.0)))(phase=0.25)
        UnitDelay()(Sum("+-+")(1.0, 2.0, math.inf))
        StateMachine(
            takes={"u": "1"},
            gives={"y": "1"},
            states={"b": {"y": 2.0}, "a": {"y": 1.0}},
            transitions=[("b", "a", "u > 1")],
        )(0.5)


def test_a_diagram_read_from_json_has_the_same_schedule_and_hash():
    diagram = knee()
    again = from_json(to_json(diagram))
    assert (
        to_json(again) == to_json(diagram)
        and content_hash(again) == content_hash(diagram) == json.loads(to_json(diagram))["hash"]
    )
    first, second = compile(diagram), compile(again)
    assert [(s.name, s.every, s.conditions, s.table) for s in first.output] == [
        (s.name, s.every, s.conditions, s.table) for s in second.output
    ]
    assert (
        np.array_equal(first.arena, second.arena, equal_nan=True)
        and first.signals == second.signals
        and first.proofs == second.proofs
    )
    assert again["left/torque_limiter"].live("limit") == (0.0, 9.0, 2.0)


def test_the_hash_covers_parameters_wires_and_rate_but_not_the_order_of_making():
    assert content_hash(knee()) == content_hash(knee(reverse=True))
    others = [knee(rate=100)]
    with Diagram("knee", rate=200) as other_gain:
        Gain(3.0)(1.0)
    with Diagram("knee", rate=200) as rewired:
        Gain()(1.0)
    with Diagram("knee", rate=200) as same_but_a_wire:
        Gain()(2.0)
    hashes = {content_hash(d) for d in [knee(), *others, rewired, other_gain, same_but_a_wire]}
    assert len(hashes) == 5


def test_a_local_block_is_written_with_its_source_and_not_loaded_unless_trusted():
    with Diagram("d", rate=100) as diagram:
        Local()(1.0)
    text = to_json(diagram)
    assert json.loads(text)["blocks"][0]["local"] is True
    with pytest.raises(DiagramError) as refused:
        from_json(text)
    assert refused.value.diagnostics[0].code == "TW032" and refused.value.diagnostics[0].path == "local"
    assert to_json(from_json(text, trust=(__name__,))) == text


def test_a_newer_format_is_rejected_with_reason():
    data = json.loads(to_json(knee())) | {"format": 2}
    with pytest.raises(DiagramError) as refused:
        from_json(json.dumps(data))
    assert (
        refused.value.diagnostics[0].code == "TW030"
        and "format 2" in str(refused.value)
        and "pip install --upgrade tickwork" in str(refused.value)
    )


def test_a_missing_library_is_named_with_the_line_that_installs_it():
    data = json.loads(to_json(knee()))
    data["blocks"][0]["type"] = "gait_lab.blocks:Phase"
    data["libraries"] = {"gait-lab": "1.2"}
    with pytest.raises(DiagramError) as refused:
        from_json(json.dumps(data))
    (problem,) = refused.value.diagnostics
    assert problem.code == "TW031" and problem.hint == "pip install gait-lab==1.2"


def test_only_blocks_are_loaded_by_name():
    data = json.loads(to_json(knee()))
    for name in ("graph.store:from_json", "blocks.filters:NoSuch", "graph.block:Live"):
        data["blocks"][0]["type"] = name
        with pytest.raises(DiagramError) as refused:
            from_json(json.dumps(data))
        assert refused.value.diagnostics[0].code == "TW031"


def test_the_hash_covers_the_content_of_a_played_file_and_not_its_path(tmp_path):
    def playing(path):
        with Diagram("playing", rate=100) as diagram:
            Playback(str(path), "angle")
        return diagram

    file, moved = tmp_path / "walk.csv", tmp_path / "elsewhere.csv"
    file.write_text("time,angle\n0,1\n1,2\n")
    before = content_hash(playing(file))
    moved.write_text(file.read_text())
    assert content_hash(playing(moved)) == before == json.loads(to_json(playing(file)))["hash"]
    assert content_hash(from_json(to_json(playing(file)))) == before
    diagram = playing(file)
    file.write_text("time,angle\n0,1\n1,3\n")
    assert content_hash(playing(file)) != before
    text = to_json(diagram)
    file.unlink()
    with pytest.raises(DiagramError) as caught:
        to_json(diagram)
    (found,) = caught.value.diagnostics
    assert (found.code, found.path) == ("TW010", "playback") and found.message == (
        f"file: cannot read {file}: No such file or directory"
    )
    with pytest.raises(DiagramError, match=f"cannot read {file}"):
        from_json(text)


def test_the_hash_covers_the_bounds_of_live_parameters_and_not_their_values():
    def hashed(stiffness):
        with Diagram("d", rate=100) as diagram:
            Impedance(stiffness=stiffness, name="law")(position=0.1, velocity=0.0)
        return content_hash(diagram)

    assert hashed(30.0) == hashed(40.0)  # declared live
    assert hashed(Live(30.0, max=50.0)) == hashed(Live(20.0, max=50.0)) != hashed(Live(30.0, max=60.0))
    assert hashed(30.0) != hashed(Live(30.0, max=50.0))


def test_a_local_module_is_not_suggested_to_pip():
    text = json.dumps({**json.loads(to_json(knee())), "libraries": {}}).replace("graph.arithmetic:", "os:")
    [found] = pytest.raises(DiagramError, from_json, text).value.diagnostics
    assert found.code == "TW031" and "pip" not in found.hint and "trust=('os',)" in found.hint


def test_a_library_is_found_in_the_process_in_which_it_is_installed(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("hiplab", "anklelab"):
        assert name not in registered()
        (tmp_path / f"{name}-1.0.dist-info").mkdir()
        (tmp_path / f"{name}-1.0.dist-info" / "entry_points.txt").write_text(
            f"[{ENTRY_POINTS}]\n{name} = {name}.blocks\n"
        )
        (tmp_path / f"{name}-1.0.dist-info" / "METADATA").write_text(f"Name: {name}\nVersion: 1.0\n")
        assert registered()[name] == name


KINDS = '''
"""Class Quoted is below:

class Quoted:
"""
if True:
    class Quoted: pass

class Outer:
    class Inner: pass
    class Later: pass

class Tabbed:
\tclass Inside: pass

def mark(kind): return kind
def named(text): return mark

@named("""
text at the margin
""")
class Described: pass

@named(
"text"
)
class Bracketed: pass

@mark
class Decorated: pass

@mark

class Separated(Outer): pass

@(
    mark
)
# a comment
class Spread(Outer): pass

NOTE = """
class Shown(Outer):
    text = "an example"
"""
class Shown  (Outer): pass

class Plain(Outer):
# a comment at the margin
    text = """
class Plain(Outer): ..."""

class Later(Outer):
    """Text,
and at the margin."""

    # a comment, and a blank line

# the next class
class Commented: pass
class Adjacent(Outer): pass
'''


def test_the_source_of_a_class_is_what_inspect_finds(tmp_path, monkeypatch):
    (tmp_path / "kinds.py").write_text(KINDS)
    (tmp_path / "kinds_windows.py").write_bytes(("# coding: latin-1\n" + KINDS).replace("\n", "\r\n").encode("latin-1"))
    monkeypatch.syspath_prepend(tmp_path)
    library = {kind for kind in Block.__subclasses__() if kind.__module__.startswith("blocks.")}
    texts = []
    for written in (import_module("kinds"), import_module("kinds_windows")):
        kinds = {name: kind for name, kind in vars(written).items() if inspect.isclass(kind)}
        assert len(kinds) == 13
        for kind in {*kinds.values(), written.Outer.Inner, written.Tabbed.Inside} | library:
            assert source_text(kind) == inspect.getsource(kind), kind
        texts.append({name: source_text(kind) for name, kind in kinds.items()})
    assert texts[0] == texts[1] and len(library) > 30


@pytest.mark.skipif(sys.version_info >= (3, 13), reason="inspect finds a class by its line")
def test_the_source_of_most_classes_is_found_without_parsing_their_file(monkeypatch):
    library = {kind for kind in Block.__subclasses__() if kind.__module__.startswith("blocks.")}
    parsed = []
    monkeypatch.setattr(inspect, "getsource", lambda kind: parsed.append(kind))
    for kind in library:
        source_text(kind)
    assert len(parsed) < 0.1 * len(library)


def test_classes_in_cells_of_a_notebook_differ_by_the_source_of_their_functions():
    hashes = []
    for number, law in enumerate(("u + 1.0", "u + 1.0", "u - 1.0")):
        cell = (
            f"class Law(Block):\n    u, y = Input('1'), Output('1')\n\n    def step(self, u):\n        return {law}\n"
        )
        name = f"<cell {number}>"  # a notebook keeps its cells like this
        linecache.cache[name] = len(cell), None, cell.splitlines(keepends=True), name
        space = {"__name__": "__main__", "Block": Block, "Input": Input, "Output": Output}
        exec(builtins.compile(cell, name, "exec"), space)
        with Diagram("cell", rate=100) as diagram:
            space["Law"]()(1.0)
        hashes.append(content_hash(diagram))
    assert hashes[0] == hashes[1] != hashes[2]
