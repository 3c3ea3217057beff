"""An I2C adapter in user space, /dev/i2c-9, with combined transfers, and register chips on its wire: what i2c-stub
lacks.

    python -m tests.hardware.i2c_adapter          reads what is on the wire as JSON, a line; then commands, and answers
    each

It takes what the adapter of a Raspberry Pi takes, no more: one read in a transfer, at its end. SMBus calls become
transfers, as the kernel's i2c-core makes them.
"""

import errno
import json
import os
import struct
import subprocess
import sys
import time
from collections import Counter

from tests.hardware import register_chips
from tests.hardware.cuse import CharacterDevice, Memory

NAME = "i2c-9"
RETRIES, TIMEOUT, SLAVE, FUNCS, RDWR, SMBUS = 0x0701, 0x0702, 0x0703, 0x0705, 0x0707, 0x0720
# I2C_FUNC_I2C, I2C_FUNC_SMBUS_EMUL without block calls that nobody here makes
COMBINED, EMULATED = 0x00000001, 0x0EFF0000
TRANSFER, MESSAGE, CALL = struct.Struct("=QI4x"), struct.Struct("=HHH2xQ"), struct.Struct("=BB2xIQ")
READS = 0x0001
QUICK, BYTE, BYTE_DATA, WORD_DATA, BLOCK = 0, 1, 2, 3, 8
UNION = 34  # bytes of i2c_smbus_data


class Adapter:
    """wire : register_chips.Wire"""

    def __init__(self, wire):
        self.wire, self.slave, self.counts = wire, 0, Counter()

    def ioctl(self, number, argument, data, room):
        if number in (SLAVE, RETRIES, TIMEOUT):
            if number == SLAVE:
                self.slave = argument
            elif number == TIMEOUT:
                self.wire.timeout = argument * 0.01
            return b""
        if number == FUNCS:
            if not room:
                raise Memory((), ((argument, 8),))
            return struct.pack("=Q", COMBINED | EMULATED)
        if number == RDWR:
            return self.transfer(argument, data)
        if number == SMBUS:
            return self.call(argument, data, room)
        raise OSError(errno.ENOTTY, "no such call")

    def transfer(self, argument, data):
        head = (argument, TRANSFER.size)
        if not data:
            raise Memory((head,))
        where, count = TRANSFER.unpack_from(data)
        table = (where, count * MESSAGE.size)
        if len(data) == TRANSFER.size:
            raise Memory((head, table))
        at = TRANSFER.size + table[1]
        messages = [MESSAGE.unpack_from(data, TRANSFER.size + k * MESSAGE.size) for k in range(count)]
        written = [(buffer, length) for _, flags, length, buffer in messages if not flags & READS]
        asked = [(buffer, length) for _, flags, length, buffer in messages if flags & READS]
        if len(data) == at and (asked or any(length for _, length in written)):
            raise Memory((head, table, *written), asked)
        if len(asked) > 1 or (asked and not messages[-1][1] & READS):
            raise OSError(errno.EOPNOTSUPP, "one read in a transfer, at its end")
        self.counts["combined" if count > 1 else "single"] += 1
        said = b""
        for address, flags, length, _ in messages:
            if flags & READS:
                said += self.wire.read(address, length)
            else:
                self.wire.write(address, data[at : at + length])
                at += length
        return said

    def call(self, argument, data, room):
        head = (argument, CALL.size)
        if not data:
            raise Memory((head,))
        reads, command, size, where = CALL.unpack_from(data)
        value = (where, {BYTE: 1, BYTE_DATA: 1, WORD_DATA: 2}.get(size, UNION))
        if size == QUICK or (size == BYTE and not reads):
            self.counts["smbus"] += 1
            self.wire.write(self.slave, b"" if size == QUICK else bytes((command,)))
            return b""
        if len(data) == CALL.size:
            raise Memory((head, value), (value,) if reads else ())
        held = data[CALL.size :]
        self.counts["smbus"] += 1
        if size not in (BYTE, BYTE_DATA, WORD_DATA, BLOCK):
            raise OSError(errno.EOPNOTSUPP, "no such call")
        count = held[0] if size == BLOCK else value[1]
        if not reads:
            self.wire.write(self.slave, bytes((command,)) + (held[1 : 1 + count] if size == BLOCK else held[:count]))
            return b""
        if size != BYTE:
            self.wire.write(self.slave, bytes((command,)))
        said = self.wire.read(self.slave, count)
        return (bytes((count,)) + said).ljust(UNION, b"\0") if size == BLOCK else said


class UserSpaceBus:
    """The adapter in a process of its own, since who calls it may hold the interpreter's lock.

    chips : of (class in register_chips, its parameters, (multiplexer's number in this list, channel) or None)
    """

    path = f"/dev/{NAME}"

    def __init__(self, *chips):
        self.process = subprocess.Popen(
            [sys.executable, "-m", __name__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.say(chips)

    def say(self, what):
        self.process.stdin.write(json.dumps(what) + "\n")
        self.process.stdin.flush()
        said = self.process.stdout.readline()
        assert said, "the adapter has ended"
        return json.loads(said)

    def behave(self, chip, **how):
        """absent : it acknowledges nothing; stuck : s for which it holds the clock low; reset : it has lost its supply
        for a moment
        """
        self.say({"chip": chip, **how})

    def registers(self, chip, first, count=1, bank=None, inner=False):
        return bytes.fromhex(self.say({"chip": chip, "first": first, "count": count, "bank": bank, "inner": inner}))

    @property
    def counts(self):
        """How many transfers there were, of one message, combined, and by SMBus; switches : writes to multiplexers."""
        return self.say({})

    def close(self):
        self.process.stdin.close()
        self.process.stdout.close()
        self.process.wait(5.0)


def obey(command, chips, adapter):
    if "chip" not in command:
        return {
            **adapter.counts,
            "switches": sum(getattr(chip, "written", 0) for chip in chips),
            "timeout": adapter.wire.timeout,
        }
    chip = chips[command["chip"]]
    if "first" in command:
        registers = (
            (chip.inner if command["inner"] else chip).registers
            if command["bank"] is None
            else chip.banks[command["bank"]]
        )
        return registers[command["first"] : command["first"] + command["count"]].hex()
    chip.absent = command.get("absent", chip.absent)
    chip.stuck_until = time.monotonic() + command.get("stuck", 0.0)
    if command.get("reset"):
        chip.reset()
        if hasattr(chip, "inner"):
            chip.inner.reset()
    return True


def main():
    chips, on_the_wire = [], []
    for kind, parameters, place in json.loads(sys.stdin.readline()):
        chips.append(getattr(register_chips, kind)(**parameters))
        (on_the_wire if place is None else chips[place[0]].behind[place[1]]).append(chips[-1])
    adapter = Adapter(register_chips.Wire(on_the_wire))
    device = CharacterDevice(NAME, adapter.ioctl)
    deadline = time.monotonic() + 5.0
    answer = True
    while not os.path.exists(UserSpaceBus.path):
        assert time.monotonic() < deadline, "the kernel has made no such device"
        time.sleep(0.01)
    while True:
        print(json.dumps(answer), flush=True)
        device.serve(sys.stdin.fileno())
        line = sys.stdin.readline()  # one command is answered before the next is written
        if not line:
            break
        answer = obey(json.loads(line), chips, adapter)
    device.close()


if __name__ == "__main__":
    main()
