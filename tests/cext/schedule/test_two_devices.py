"""Two drives with one id: more replies than questions, while replies that are late, lost or repeated are no twins."""

import random

import pytest

from graph import Diagram
from tests.cext.rigs import Rig
from tests.cext.schedule.test_stop_values import PLANT, RATE, own, robot_with, run
from tests.own_drives import FAMILIES, Wired

REPORTING = ["v3 reports", "servo"]
ANSWERING = [name for name in FAMILIES if name not in REPORTING]
FIRST, SECOND = bytes(range(8)), bytes(range(1, 9))


@pytest.mark.hazard("H5f")
@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize("position", [0.25, 0.6])
def test_two_drives_with_one_id_are_not_armed(name, position):
    outcome, rig = run(name, [own(name), own(name, position=position)], ticks=200)
    assert (outcome.culprit, outcome.tick) == ("drive0", -1)
    # where reports alternate between two angles before there are many
    assert outcome.status in ("two devices", "position jump") and (outcome.status == "two devices" or position > 0.25)


@pytest.mark.hazard("H5f")
@pytest.mark.parametrize("name", ["robstride", "robstride reports"])
def test_two_unique_numbers_behind_one_id_are_not_armed(name):
    """The drives stand alike: their equal replies are one on the wire, and nothing else differs."""
    both = [own(name, unique=FIRST), own(name, unique=SECOND)]
    outcome, _ = run(name, both, wired={"merges": True})
    assert (outcome.status, outcome.culprit, outcome.tick) == ("two devices", "drive0", -1)
    outcome, _ = run(name, [own(name, unique=FIRST)] * 2, wired={"merges": True})
    assert outcome.status == "ok"


@pytest.mark.parametrize("name", ["robstride", "robstride reports"])
def test_a_drive_that_does_not_state_its_unique_number_is_armed(name):
    assert run(name, [own(name)])[0].status == "ok"


@pytest.mark.hazard("H5f")
@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize("position", [0.25, 0.6])
def test_a_second_drive_that_appears_in_a_run_ends_it(name, position):
    class Late(Wired):
        def step(self, tick):
            self.drives[1].silent = tick < PLANT
            if tick < PLANT:
                self.drives[1].due = tick * self.period + 1
            return super().step(tick)

    robot = robot_with([name])
    with Diagram("plant", rate=PLANT):
        wired = Late([own(name), own(name, position=position)], PLANT, name="drives")
    rig = Rig(robot, wired.diagram)
    wired.end = rig.buses["bus0"].device
    outcome = rig.run(600, fade=0.0)
    # where its angle arrives first, that jumps
    assert outcome.status in ("two devices", "position jump") and outcome.culprit == "drive0"
    assert outcome.status == "two devices" or position > 0.25
    assert 200 <= outcome.tick + rig.executor.arming_rounds < 235


@pytest.mark.parametrize("name", FAMILIES)
def test_ordinary_replies_are_no_twins(name):
    chance = random.Random(3)
    for transit, lost in (
        (lambda: 0, lambda: False),
        (lambda: 50_000_000 * (chance.random() < 0.02), lambda: False),
        (lambda: 30_000_000, lambda: False),
        (lambda: chance.randrange(30_000_000), lambda: False),
        (lambda: 0, lambda: chance.random() < 0.2),
    ):
        outcome, _ = run(name, [own(name)], ticks=400, wired={"transit": transit, "lost": lost})
        assert outcome.status != "two devices"


@pytest.mark.parametrize("name", REPORTING)
@pytest.mark.parametrize("clock, expected", [(0.9, "ok"), (1.1, "ok"), (1.5, "two devices")])
def test_only_reports_that_are_far_too_frequent_are_of_two_drives(name, clock, expected):
    outcome, _ = run(name, [own(name, reports=clock * RATE)], ticks=1000)
    assert outcome.status == expected


@pytest.mark.parametrize("name", REPORTING)
def test_reports_that_have_waited_since_before_arming_are_not_counted(name):
    robot = robot_with([name])
    with Diagram("plant", rate=PLANT):
        wired = Wired([own(name)], PLANT, name="drives")
    rig = Rig(robot, wired.diagram)
    wired.end = rig.buses["bus0"].device
    frame = FAMILIES[name].report(1, 0.0, False)
    for _ in range(50):
        wired.end.send(frame.identifier, frame.data, frame.extended, -1)
    assert rig.run(200, fade=0.0).status == "ok"


@pytest.mark.parametrize("name", ANSWERING)
def test_replies_in_bursts_are_no_twins(name):
    """An adapter that delivers what it has received every 50 ms."""

    class Bursts(Wired):
        def step(self, tick):
            self.transit = lambda: 50_000_000 - tick * self.period % 50_000_000
            return super().step(tick)

    robot = robot_with([name])
    with Diagram("plant", rate=PLANT):
        wired = Bursts([own(name)], PLANT, name="drives")
    rig = Rig(robot, wired.diagram)
    wired.end = rig.buses["bus0"].device
    assert rig.run(400, fade=0.0).status == ("silent" if name == "v3" else "ok")  # it may have restarted meanwhile


@pytest.mark.parametrize("name", ANSWERING)
def test_repeated_replies_are_no_twins(name):
    chance = random.Random(5)

    class Repeating(Wired):
        def step(self, tick):
            torque = super().step(tick)
            if self.last and chance.random() < 0.05:
                frame = self.last
                self.end.send(frame.identifier, frame.data, frame.extended, tick * self.period)
            self.last = None
            return torque

        last = None

    def keep(drive):
        hear = drive.hear

        def heard(*frame):
            frames = hear(*frame)
            wired.last = frames[-1] if frames else wired.last
            return frames

        drive.hear = heard
        return drive

    robot = robot_with([name])
    with Diagram("plant", rate=PLANT):
        wired = Repeating([keep(own(name))], PLANT, name="drives")
    rig = Rig(robot, wired.diagram)
    wired.end = rig.buses["bus0"].device
    assert rig.run(1000, fade=0.0).status == "ok"
