"""Process that receives the signed datagrams of a bus, and passes on the frames of those that count.

The loop receives the frames as those of an unsigned bus, without a calculation in its tick. If this process ends or
hangs, no frames arrive, which ends the run like a silent button.
"""

from __future__ import annotations

import os
import select
import socket
import sys
from contextlib import suppress

from runtime.host.child_process import ChildProcess
from runtime.host.ending import ignore_signals
from runtime.host.run_mark import remove_mark
from runtime.host.signed_datagrams import DATAGRAM_BYTES, KEY_BYTES, Receiver

PRIORITY = 79  # of SCHED_FIFO, below that of the loop and of the guardian


class Verifier(ChildProcess):
    """The process of one bus.

    key : shared with the sender
    received : bound UDP socket
    passed : AF_UNIX datagram socket to which frames are sent
    """

    def __init__(self, key: bytes, received: socket.socket, passed: socket.socket) -> None:
        numbers = received.fileno(), passed.fileno()
        super().__init__("runtime.robot.rig.verifier", numbers, numbers)
        self._send(key)

    def close(self) -> None:
        """End the process."""
        self.end()


def main(answers: int, control: int, received: int, passed: int) -> None:
    """Run the process until the control process ends. The arguments are file descriptors; the key is in the orders."""
    ignore_signals()
    remove_mark()
    with open("/proc/self/comm", "w") as file:
        file.write("tickwork-verify")
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    key = sys.stdin.buffer.read(KEY_BYTES)
    if len(key) == KEY_BYTES:
        verify(Receiver(key), socket.socket(fileno=received), socket.socket(fileno=passed), control)


def verify(receiver: Receiver, received: socket.socket, passed: socket.socket, control: int) -> None:
    """Pass frames on until a process has ended. control : its pidfd"""
    received.setblocking(False)
    passed.setblocking(False)
    poll = select.poll()
    for descriptor in (received.fileno(), control):
        poll.register(descriptor, select.POLLIN)
    while not any(descriptor == control for descriptor, _ in poll.poll()):
        with suppress(BlockingIOError):
            datagram, sender = received.recvfrom(DATAGRAM_BYTES + 1)
            frame, reply = receiver.frame(datagram)
            with suppress(OSError):  # a full queue, a sender that is gone
                if frame is not None:
                    passed.send(frame)
                elif reply is not None:
                    received.sendto(reply, sender)
