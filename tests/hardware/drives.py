"""Drives on a CAN interface, by python-can and the reference: each answers every frame to its id, and is held still."""

import threading

import can

from tests.blocks.actuators import reference

AK10_9 = reference.ranges(velocity=50.0, torque=65.0)


def is_answer(identifier, data):
    """Whether data on a drive's id is its reply: no command of a joint near zero begins with so small a position."""
    return data[0] == identifier and data[6:] == bytes([30 + 40, 0])


class Drives:
    """motors : where each motor is, in rad, by id. A thread of this process; the robot is in another.

    answers : whether they reply
    """

    def __init__(self, motors, channel="vcan0"):
        self.motors = motors
        self.bus = can.Bus(channel, interface="socketcan")
        self.thread = threading.Thread(target=self._answer, daemon=True)
        self.powered = self.answers = True

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *exception):
        self.cut_power()
        self.bus.shutdown()

    def cut_power(self):
        self.powered = False
        self.thread.join(10)

    def _answer(self):
        while self.powered:
            try:
                heard = self.bus.recv(0.02)
            except can.CanError:  # its interface was taken down
                return
            if (
                heard is not None
                and self.answers
                and heard.arbitration_id in self.motors
                and not heard.is_extended_id
                and not heard.is_error_frame
            ):
                data = reference.held_reply(
                    AK10_9, heard.arbitration_id, self.motors[heard.arbitration_id], bytes(heard.data)
                )
                self.bus.send(can.Message(arbitration_id=heard.arbitration_id, is_extended_id=False, data=data))
