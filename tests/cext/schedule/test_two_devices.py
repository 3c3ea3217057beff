"""Two drives with one id: more replies than questions, while replies that are late, lost or repeated are no twins."""

import random

import pytest

from graph import Diagram
from tests.cext.rigs import Rig
from tests.cext.schedule.test_stop_values import PLANT, own, robot_with, run
from tests.own_drives import FAMILIES, Wired

ANSWERING = [name for name in FAMILIES if name not in ("v3", "servo")]


@pytest.mark.hazard("H5f")
@pytest.mark.parametrize("name", ANSWERING)
def test_two_drives_with_one_id_are_not_armed(name):
    outcome, rig = run(name, [own(name), own(name, position=0.6)], ticks=200)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("two devices", "drive0", -1)


@pytest.mark.hazard("H5f")
@pytest.mark.parametrize("name", ANSWERING)
def test_a_second_drive_that_appears_in_a_run_ends_it(name):
    class Late(Wired):
        def step(self, tick):
            self.drives[1].silent = tick < PLANT
            return super().step(tick)

    robot = robot_with([name])
    with Diagram("plant", rate=PLANT):
        wired = Late([own(name), own(name, position=0.6)], PLANT, name="drives")
    rig = Rig(robot, wired.diagram)
    wired.end = rig.buses["bus0"].device
    outcome = rig.run(600, fade=0.0)
    # where its angle arrives first, that jumps
    assert outcome.status in ("two devices", "position jump") and outcome.culprit == "drive0"
    assert 195 <= outcome.tick < 230


@pytest.mark.parametrize("name", FAMILIES)
def test_ordinary_replies_are_no_twins(name):
    chance = random.Random(3)
    for transit, lost in (
        (lambda: 0, lambda: False),
        (lambda: 30_000_000, lambda: False),
        (lambda: chance.randrange(30_000_000), lambda: False),
        (lambda: 0, lambda: chance.random() < 0.2),
    ):
        outcome, _ = run(name, [own(name)], ticks=400, transit=transit, lost=lost)
        assert outcome.status != "two devices"


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
    assert rig.run(400, fade=0.0).status == "ok"


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
