"""The drive: its blocks conform, and its set-up is a dialogue that a test answers without a bus."""

import pytest
from gaitlab.drive import EmulatedGaitDrive, GaitDrive, protocol
from gaitlab.drive.family import FAMILY

from graph.conformance import check_block
from graph.dialogue import Confirm, Listen, Rejected, Send, Show
from graph.family import Request


@pytest.mark.parametrize("kind", [GaitDrive, EmulatedGaitDrive])
def test_block_passes_the_conformance_test(kind):
    assert check_block(kind)


class Drive:
    """Answers a dialogue as a drive with an id would; `sent` has the frames."""

    def __init__(self, can_id, position):
        self.can_id, self.position, self.sent, self.replies = can_id, position, [], []

    def answer(self, dialogue):
        reply = None
        while True:
            try:
                step = dialogue.send(reply)
            except StopIteration as end:
                return end.value
            reply = {Send: self.take, Listen: self.give, Show: lambda step: None, Confirm: lambda step: True}[
                type(step)
            ](step)

    def take(self, step):
        self.sent.append(step.frame)
        identifier, _, data = step.frame
        if identifier == protocol.COMMAND + self.can_id:
            if data[0] == protocol.ZERO:
                self.position = 0
            if data[0] == protocol.SET_ID:
                self.can_id = data[2]
            state = b"\x80\x41" + self.position.to_bytes(2, "little") + bytes(4)
            self.replies.append((protocol.REPLY + self.can_id, False, state))
        return True

    def give(self, step):
        replies, self.replies = self.replies, []
        return replies


def test_zero_and_id_are_set_and_confirmed():
    drive = Drive(5, 400)
    assert drive.answer(FAMILY.set_up(Request(5, zero=True, new_id=9))) is True
    assert (drive.can_id, drive.position) == (9, 0)
    assert [data[0] for _, _, data in drive.sent if data[0] != protocol.DISABLE] == [protocol.ZERO, protocol.SET_ID]


def test_a_drive_of_another_family_is_not_configured():
    drive = Drive(5, 400)
    assert drive.answer(FAMILY.set_up(Request(6, zero=True))) is None and drive.position == 400


def test_unsupported_operations_are_rejected_before_any_change():
    drive = Drive(5, 400)
    with pytest.raises(Rejected, match="--save: the gait laboratory's drive cannot do that"):
        drive.answer(FAMILY.set_up(Request(5, zero=True, save=True)))
    assert {data[0] for _, _, data in drive.sent} == {protocol.DISABLE} and drive.position == 400
