"""A tick of eight drives in a program on python-can: a Message object for each frame, a Notifier thread for answers.

The bus is python-can's SocketcanBus with its own code for sending and receiving, over a datagram socket in place of a
CAN interface.
"""

import math
import threading
import time

from can import BusABC, Listener, Message, Notifier
from can.interfaces.socketcan.socketcan import SocketcanBus

from cext.bus.socketcan import SocketCan
from tests.bench.can_cost import ANSWERS, ends

POSITION, VELOCITY, TORQUE = 12.5, 50.0, 18.0  # half ranges of an AK80-9's wire
LIMIT = 5.0  # N·m
ANSWER_TIMEOUT = 1.0  # s


class DatagramBus(SocketcanBus):
    """Over a connected socket that stamps what arrives."""

    def __init__(self, socket):
        self.socket, self.channel = socket, "bench"
        self._bcm_sockets, self._is_filtered, self._task_id, self._task_id_guard = {}, False, 0, threading.Lock()
        BusABC.__init__(self, channel="bench")

    def _apply_filters(self, filters):
        pass  # the socket has no other sender


def code(x, low, high, bits):
    return int((x - low) * ((1 << bits) - 1) / (high - low))


def value(code, low, high, bits):
    return code * (high - low) / ((1 << bits) - 1) + low


def pack(torque):
    """A command of torque alone."""
    p, v, t = code(0.0, -POSITION, POSITION, 16), code(0.0, -VELOCITY, VELOCITY, 12), code(torque, -TORQUE, TORQUE, 12)
    return bytes([p >> 8, p & 0xFF, v >> 4, (v & 15) << 4, 0, 0, t >> 8, t & 0xFF])


class Feedback(Listener):
    """The last answer of each drive, by id."""

    def __init__(self):
        self.newest, self.count = {}, 0

    def on_message_received(self, message):
        data = message.data
        if len(data) == 8:
            self.newest[data[0]] = (
                value(data[1] << 8 | data[2], -POSITION, POSITION, 16),
                value(data[3] << 4 | data[4] >> 4, -VELOCITY, VELOCITY, 12),
                value((data[4] & 15) << 8 | data[5], -TORQUE, TORQUE, 12),
                data[6] - 40,
                data[7],
                message.timestamp,
            )
        self.count += 1


def measure(ticks):
    """Return the processor time of each tick, in µs, over the socket that Tickwork is timed with."""
    with ends() as (own, other):
        return [seconds * 1e6 for seconds in time_of_ticks(own, SocketCan(other).end, ANSWERS, ticks)]


def time_of_ticks(socket, other, answers, ticks):
    """Return the processor time of each tick, in s, of the loop and of the Notifier's thread together.

    other : BusEnd at the far end; answers : (id, data) that the drives send in every tick
    """
    bus, feedback = DatagramBus(socket), Feedback()
    notifier = Notifier(bus, [feedback], timeout=0.1)
    [thread] = notifier._readers
    clock = time.pthread_getcpuclockid(thread.ident)
    took = []
    try:
        for tick in range(ticks):
            before, began = time.clock_gettime(clock), time.thread_time()
            torque = 3.0 * math.sin(6.283185307179586 * tick / 1000.0)
            now = time.time()
            for can_id, _ in answers:
                answer = feedback.newest.get(can_id)
                if answer is not None and (answer[4] or now - answer[5] > 0.5):
                    raise OSError("a drive does not answer or reports a fault")
                if not math.isfinite(torque):
                    raise OSError("the torque is not finite")
                bus.send(
                    Message(arbitration_id=can_id, is_extended_id=False, data=pack(min(max(torque, -LIMIT), LIMIT)))
                )
            spent = time.thread_time() - began
            for can_id, data in answers:
                other.send(can_id, data)
            deadline = time.monotonic() + ANSWER_TIMEOUT
            while feedback.count < len(answers) * (tick + 1):
                if time.monotonic() > deadline:
                    raise OSError("an answer was lost")
                time.sleep(20e-6)
            if len(other.receive()) != len(answers):
                raise OSError("a command was lost")
            took.append(spent + time.clock_gettime(clock) - before)
    finally:
        notifier.stop()
        bus.shutdown()
    return took
