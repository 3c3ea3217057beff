"""Stand-in for the computer of a robot, on which programs of Epically Powerful use the devices of `emulate`.

    python reference_host.py PROGRAM [ARGUMENT...]

PROGRAM is one of its example scripts, or a command such as ep-stream-actuator. It and its package run as they are,
except for DEFECTS, which end the program on any computer. In place of hardware:

    can0, SocketCAN       the multicast group in the variable REFERENCE_CAN, with a port or the usual one
    /dev/ttyACM*          the terminals that TICKWORK_PORTS matches
    I2C bus 1             the socket in REFERENCE_I2C
    GPIO pin 7            the socket in REFERENCE_GPIO
    Jetson                this computer: the package reads an OpenIMU on no other one

This file imports nothing of the project, since another Python runs it.
"""

import atexit
import collections
import glob
import importlib.metadata
import os
import platform
import socket
import struct
import sys
import time
import types
from pathlib import Path

import can
from can.interfaces.udp_multicast import UdpMulticastBus

DEFECTS = {  # {script: texts and their replacements}
    "position_controller.py": [("ACT_ID", "actuator_id")],  # a name that the script does not define
    "display_mpu9250_imu_data.py": [(f"['{name}']", f'["{name}"]') for name in ("bus", "channel", "address")],
}
MEMORY = 64  # frames whose echo the host has not received yet


class Group(UdpMulticastBus):
    """Multicast group, without the frames of this process: SocketCAN does not return them either."""

    def __init__(self):
        self.sent = collections.deque(maxlen=MEMORY)
        group, _, port = os.environ["REFERENCE_CAN"].partition(":")
        super().__init__(channel=group, **({"port": int(port)} if port else {}))

    def send(self, msg, timeout=None):
        self.sent.append((msg.arbitration_id, bytes(msg.data)))
        super().send(msg, timeout)

    def _recv_internal(self, timeout):
        message, filtered = super()._recv_internal(timeout)
        if message is not None and (message.arbitration_id, bytes(message.data)) in self.sent:
            self.sent.remove((message.arbitration_id, bytes(message.data)))
            return None, filtered
        return message, filtered


class Wire:
    """smbus2.SMBus on the socket of an emulated bus."""

    def __init__(self, bus=None):
        self.number, self.end = 0, None
        if bus is not None:
            self.end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            self.end.connect(os.environ["REFERENCE_I2C"])

    def ask(self, address, register, data=b"", count=0):
        self.number = (self.number + 1) & 0xFF
        registered = register >= 0
        head = bytes((self.number, address, count > 0, registered, register if registered else 0, count or len(data)))
        self.end.send(head + data)
        reply = self.end.recv(64)
        if reply[1]:
            raise OSError(reply[1], os.strerror(reply[1]))
        return reply[2:]

    def write_byte(self, i2c_addr, value):
        self.ask(i2c_addr, -1, bytes((value,)))

    def write_byte_data(self, i2c_addr, register, value):
        self.ask(i2c_addr, register, bytes((value,)))

    def read_byte_data(self, i2c_addr, register):
        return self.ask(i2c_addr, register, count=1)[0]

    def read_i2c_block_data(self, i2c_addr, register, length):
        return list(self.ask(i2c_addr, register, count=length))


class Pins(types.ModuleType):
    """Jetson.GPIO with one input, whose reads are counted.

    A read takes READ_TIME, longer than a pass of the program's loop: it writes the rows of a full buffer or loses them,
    as its threads fall, and this way the buffer is never full.
    """

    READ_TIME = 0.006  # s

    BOARD, IN, LEVEL = "board", "in", struct.Struct("=QI")  # time and kind of struct gpio_v2_line_event
    RISING = 1

    def setmode(self, mode):
        pass

    def setup(self, channel, direction):
        self.end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.end.connect(os.environ["REFERENCE_GPIO"])
        self.level = self.LEVEL.unpack_from(self.end.recv(64))[1] == self.RISING
        self.end.setblocking(False)
        self.reads = 0
        atexit.register(lambda: print(f"pin {channel} was read {self.reads} times"))

    def input(self, channel):
        time.sleep(self.READ_TIME)
        self.reads += 1
        try:
            while event := self.end.recv(64):
                self.level = self.LEVEL.unpack_from(event)[1] == self.RISING
        except BlockingIOError:
            pass
        return int(self.level)


def terminals():
    """Return {path: its device}, as mscl.Devices.listInertialDevices, which finds devices on USB only."""
    import mscl

    class Device:
        def __init__(self, path):
            self.text = mscl.InertialNode(mscl.Connection.Serial(path)).serialNumber()

        def serial(self):
            return self.text

    return {path: Device(path) for path in glob.glob(os.environ.get("TICKWORK_PORTS", ""))}


def be_a_robot():
    """Replace what the package uses of the computer."""
    import mscl
    import smbus2

    serial = mscl.Connection.Serial
    mscl.Connection.Serial = staticmethod(lambda path, *rest: serial(path, *(rest or (115200,))))
    mscl.Devices.listInertialDevices = staticmethod(terminals)
    can.Bus = lambda *_, **__: Group()
    smbus2.SMBus = Wire
    os.system = lambda command: 0  # sudo modprobe, ip link, chmod
    sys.modules["Jetson"] = types.ModuleType("Jetson")
    sys.modules["Jetson"].GPIO = sys.modules["Jetson.GPIO"] = Pins("Jetson.GPIO")
    kernel = platform.uname()._replace(release="5.15.0-tegra", machine="aarch64")
    platform.uname = lambda: kernel


def main(program, *arguments):
    be_a_robot()
    sys.argv = [program, *arguments]
    if program.endswith(".py"):
        text = Path(program).read_text()
        for before, after in DEFECTS.get(Path(program).name, []):
            text = text.replace(before, after)
        exec(compile(text, program, "exec"), {"__name__": "__main__"})
    else:
        [command] = [each for each in importlib.metadata.entry_points(group="console_scripts") if each.name == program]
        command.load()()


if __name__ == "__main__":
    main(*sys.argv[1:])
