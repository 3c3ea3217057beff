"""Device families: how they are found, and that their dialogues work without a bus."""

import importlib.metadata
import struct

import pytest

from blocks.actuators import CubeMars, RobStride, RobStrideMIT
from blocks.actuators.robstride import frames
from blocks.families import families, family_of, find_model
from graph import Diagram
from graph.dialogue import Confirm, Listen, Rejected, Send, Show
from graph.family import Family, Request
from tests.checkout import copy_packages, python

NAMES = {"RobStride", "CubeMars", "InvenSense", "MicroStrain", "OpenIMU", "converters and encoders"}


class Point:
    """An entry point."""

    def __init__(self, value, load):
        self.value, self.load = value, load


@pytest.fixture
def plugged(monkeypatch):
    """Replaces the entry points: plugged(Point, ...)."""

    def plug(*points):
        monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: points)
        families.cache_clear()

    yield plug
    monkeypatch.undo()
    families.cache_clear()


def test_builtin_families_are_discovered_without_installation(tmp_path):
    copy_packages(tmp_path)
    code = "import importlib.metadata as m; m.entry_points = lambda group: (); "
    code += "from blocks.families import families; print([family.name for family in families()])"
    done = python("-c", code, cwd=tmp_path)
    assert set(eval(done.stdout)) == NAMES, done.stderr


def test_a_family_that_cannot_be_loaded_is_reported_and_the_others_work(plugged):
    def broken():
        raise ImportError("no module named lab")

    plugged(Point("lab.family:FAMILY", broken), Point("lab.other:FAMILY", lambda: 3))
    with pytest.warns(UserWarning) as warnings:
        assert {family.name for family in families()} == NAMES
    assert [str(warning.message).partition(" cannot be loaded: ")[::2] for warning in warnings] == [
        ("device family lab.family:FAMILY", "ImportError: no module named lab"),
        ("device family lab.other:FAMILY", "TypeError: expected an instance of graph.family.Family, got 3"),
    ]


def test_model_is_selected_by_name_and_option(plugged):
    plugged()
    assert [find_model(name)[0].block.__name__ for name in ("AK80-9", "AKE60-8", "rs02")] == [
        "CubeMars",
        "CubeMarsV3",
        "RobStride",
    ]
    assert find_model("AK80-9", "servo")[0].block.__name__ == "CubeMarsServo"


@pytest.mark.parametrize(
    "name, cause",
    [
        ("AK80", "'AK80' is not a CubeMars model"),
        ("RS2", "'RS2' is not a RobStride model: did you mean 'RS02'?"),
        ("GL40", "no device family that is installed has a model 'GL40'; blocks --actuators lists them"),
    ],
)
def test_the_most_similar_family_reports_the_cause(name, cause):
    with pytest.raises(ValueError) as refused:
        find_model(name)
    assert str(refused.value).startswith(cause)


def test_every_actuator_block_has_a_family_that_can_query_it():
    for family in families():
        for drive in family.drives:
            model = next(iter(family.tables[-1 if drive.block.__name__.endswith("V3") else 0].models))
            with Diagram("one", rate=200):
                block = drive.block(model, can_id=3)
            assert family_of(block) is family
            frame, read = family.stop_query(block).frame, family.stop_query(block).read
            assert frame is not None and read(0x7FF, False, b"") is None


@pytest.mark.parametrize(
    "kind, model, identifier, extended, data",
    [
        (CubeMars, "AK80-6", 3, False, "03f0008008004600"),
        (RobStride, "RS00", 0x0280037F, True, "f000 8000 8000 012c"),
        (RobStrideMIT, "RS00", 0x7F, False, "03f000800800012c"),
    ],
)
def test_the_stop_query_of_a_block_has_the_ranges_of_its_unit(kind, model, identifier, extended, data):
    """A joint that `configure` measures has the same angle as in a run, also behind firmware with other ranges."""
    with Diagram("one", rate=200):
        block = kind(model, can_id=3, wire_position=95.5, **({} if kind is CubeMars else {"host_id": 0x7F}))
    answer = family_of(block).stop_query(block).read(identifier, extended, bytes.fromhex(data))
    assert answer.position == pytest.approx(95.5 * (2 * 0xF000 / 0xFFFF - 1), abs=1e-9)


def test_a_family_with_drives_requires_a_stop_query():
    drives = next(family.drives for family in families() if family.drives)
    with pytest.raises(TypeError, match=r"Incomplete has drives: define stop_query\(self, block\)"):
        type("Incomplete", (Family,), {"drives": drives})
    assert type("Sensors", (Family,), {})().drives == ()


def carried_out(dialogue, answers, permission=True):
    """Carry a dialogue out with a device in place of a bus. Returns (result, frames sent, lines shown).

    answers : frame -> frames that the device answers with
    """
    reply, pending, sent, lines = None, [], [], []
    while True:
        try:
            step = dialogue.send(reply)
        except StopIteration as end:
            return end.value, sent, lines
        reply = None
        if isinstance(step, Send):
            sent.append(step.frame)
            pending += answers(step.frame)
        elif isinstance(step, Listen):
            reply, pending = pending, []
        elif isinstance(step, Show):
            lines += step.lines
        else:
            assert step == Confirm("apply these changes")
            reply = permission


def robstride(values):
    """A drive with id 9 in the private protocol; values : {index of a parameter: number}"""

    def answers(frame):
        identifier, extended, data = frame
        kind, target = identifier >> 24, identifier & 0xFF
        state = (frames.FEEDBACK << 24 | 9 << 8 | 0xFD, True, bytes.fromhex("8000800080000140"))
        if not extended or target != 9:
            return []
        if kind == frames.GET_ID:
            return [(9 << 8 | 0xFE, True, bytes(range(8)))]
        if kind == frames.STOP and data[1] == 0xC4:
            return [(state[0], True, bytes([0x00, 0xC4, 0x56, 0, 3, 1, 7, 0]))]
        if kind == frames.SET_ZERO:
            values[0x7019] = 0.0
        if kind == frames.READ:
            index = struct.unpack_from("<H", data)[0]
            value = struct.pack("<HHf", index, 0, values.get(index, 0.0))
            return [(frames.READ << 24 | 9 << 8 | 0xFD, True, value)]
        return [state]

    return answers


def test_a_zero_is_set_after_a_stop_and_read_back():
    [family] = [family for family in families() if family.name == "RobStride"]
    done, sent, lines = carried_out(family.set_up(Request(9, zero=True)), robstride({0x7019: 0.25}))
    kinds = [identifier >> 24 for identifier, _, _ in sent]
    assert done is True and kinds.count(frames.SET_ZERO) == 1
    assert kinds.index(frames.STOP) < kinds.index(frames.SET_ZERO) and frames.ENABLE not in kinds
    assert lines[-2:] == ["  position: 0.25 rad -> 0 rad", "done: position is 0.0000 rad"]


def test_write_requires_permission():
    [family] = [family for family in families() if family.name == "RobStride"]
    done, sent, _ = carried_out(family.set_up(Request(9, zero=True)), robstride({}), permission=False)
    assert done is True and frames.SET_ZERO not in [identifier >> 24 for identifier, _, _ in sent]


def test_an_id_without_a_drive_of_the_family_is_passed_to_the_next():
    for family in families():
        if family.drives:
            done, sent, lines = carried_out(family.set_up(Request(7, zero=True)), robstride({}))
            assert (done, lines) == (None, []) and all(identifier & 0xFF == 7 for identifier, _, _ in sent)


@pytest.mark.parametrize("request_", [Request(3, new_id=4), Request(3, reads=("all",)), Request(3, protocol="mit")])
def test_unsupported_operation_is_rejected_before_sending(request_):
    [family] = [family for family in families() if family.name == "CubeMars"]
    with pytest.raises(Rejected, match="CubeMars' software"):
        family.check(request_)
