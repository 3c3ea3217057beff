"""Chips on an I2C wire, as their data sheets have them: registers, what a write does to them, and which of them are
heard when.

Written from RM-MPU-9250A-00 1.6, MS1356-E-02 (AK8963), DS-000189 1.5 (ICM-20948 with AK09916) and SCPS143 (TCA9548A),
not from the blocks that read them: nothing is measured before a chip has been woken, nothing of the fuses is readable
out of their mode.
"""

import errno
import time


class Chip:
    """A pointer and 256 registers behind it, which moves on by one with each byte."""

    defaults = {}

    def __init__(self, address):
        self.address, self.absent, self.stuck_until = address, False, 0.0
        self.reset()

    def reset(self):
        self.pointer, self.registers = 0, bytearray(256)
        for register, value in self.defaults.items():
            self.registers[register] = value

    def heard(self):
        """Every chip that is on the wire with it."""
        return [] if self.absent else [self]

    def write(self, data):
        if data:
            self.pointer = data[0]
        for byte in data[1:]:
            self.store(self.pointer, byte)
            self.pointer = (self.pointer + 1) % 256

    def read(self, count):
        self.sample()
        said = bytearray()
        for _ in range(count):
            said.append(self.load(self.pointer))
            self.pointer = (self.pointer + 1) % 256
        return bytes(said)

    def sample(self):
        """Measure."""

    def store(self, register, byte):
        self.registers[register] = byte

    def load(self, register):
        return self.registers[register]


class Magnetometer(Chip):
    """AK8963 or AK09916: its field in three signed codes, least significant byte first."""

    def __init__(self, address, status, control, modes, trailing, field=(0, 0, 0), fuses=b"", defaults=None):
        self.status, self.control, self.modes, self.trailing, self.field, self.fuses = (
            status,
            control,
            modes,
            trailing,
            field,
            fuses,
        )
        self.defaults = defaults
        super().__init__(address)

    def sample(self):
        data = b"".join(code.to_bytes(2, "little", signed=True) for code in self.field)
        measures = self.registers[self.control] in self.modes
        said = b"\x01" + data + self.trailing if measures else bytes(7 + len(self.trailing))
        self.registers[self.status : self.status + len(said)] = said

    def load(self, register):
        if 0x10 <= register < 0x10 + len(self.fuses):
            return self.fuses[register - 0x10] if self.registers[self.control] & 0x0F == 0x0F else 0
        return self.registers[register]


class Mpu9250(Chip):
    """With its AK8963 behind the switch that bypasses its own master."""

    defaults = {0x75: 0x71, 0x6B: 0x01}
    pins, user, power, burst, reset_value = 0x37, 0x6A, 0x6B, 0x3B, 0x80
    asleep = 0x40

    def __init__(self, address=0x68, accel=(0, 0, 0), gyro=(0, 0, 0), temperature=0, mag=(0, 0, 0), fuses="80c040"):
        self.accel, self.gyro, self.temperature = accel, gyro, temperature
        self.inner = Magnetometer(0x0C, 0x02, 0x0A, (0x12, 0x16), b"\x10", mag, bytes.fromhex(fuses), {0x00: 0x48})
        super().__init__(address)

    def heard(self):
        if self.absent:
            return []
        return (
            [self, self.inner] if self.registers[self.pins] & 0x02 and not self.registers[self.user] & 0x20 else [self]
        )

    def measured(self):
        return (*self.accel, self.temperature, *self.gyro)

    def sample(self):
        if self.registers[self.power] & self.asleep:
            return
        self.registers[self.burst : self.burst + 14] = b"".join(
            code.to_bytes(2, "big", signed=True) for code in self.measured()
        )
        if (
            self.registers[self.user] & 0x20
            and self.registers[0x27] & 0x80
            and self.registers[0x25] == 0x80 | self.inner.address
        ):
            count = self.registers[0x27] & 0x0F
            self.inner.write(bytes((self.registers[0x26],)))
            self.registers[0x49 : 0x49 + count] = self.inner.read(count)

    def store(self, register, byte):
        if register == self.power and byte & self.reset_value:
            pointer = self.pointer
            self.reset()
            self.pointer = pointer
        else:
            super().store(register, byte)


class Icm20948(Mpu9250):
    """Four banks of registers, chosen by the last of each; asleep as it comes out of a reset."""

    pins, user, power, burst = 0x0F, 0x03, 0x06, 0x2D

    def __init__(self, address=0x68, accel=(0, 0, 0), gyro=(0, 0, 0), temperature=0, mag=(0, 0, 0)):
        super().__init__(address, accel, gyro, temperature, mag)
        self.inner = Magnetometer(
            0x0C, 0x10, 0x31, (0x02, 0x04, 0x06, 0x08), b"\x00\x00", mag, b"", {0x00: 0x48, 0x01: 0x09}
        )

    def reset(self):
        self.banks = [bytearray(256) for _ in range(4)]
        self.banks[0][0x00], self.banks[0][0x06], self.banks[2][0x01], self.banks[2][0x14] = 0xEA, 0x41, 0x01, 0x01
        self.bank, self.pointer, self.registers = 0, 0, self.banks[0]

    def measured(self):
        return (*self.accel, *self.gyro, self.temperature)

    def store(self, register, byte):
        if register == 0x7F:
            self.bank = byte >> 4 & 3
        elif self.bank:
            self.banks[self.bank][register] = byte
        else:
            super().store(register, byte)

    def load(self, register):
        return self.bank << 4 if register == 0x7F else self.banks[self.bank][register]


class Tca9548a(Chip):
    """Its one register says which of eight channels are joined to the wire."""

    def __init__(self, address=0x70):
        super().__init__(address)
        self.mask, self.behind, self.written = 0, [[] for _ in range(8)], 0

    def heard(self):
        return (
            []
            if self.absent
            else [
                self,
                *(
                    one
                    for bit, chips in enumerate(self.behind)
                    if self.mask >> bit & 1
                    for chip in chips
                    for one in chip.heard()
                ),
            ]
        )

    def write(self, data):
        if data:
            self.mask, self.written = data[-1], self.written + 1

    def read(self, count):
        return bytes((self.mask,)) * count


class Wire:
    """chips : on it. `timeout` : s after which its adapter gives an exchange up"""

    def __init__(self, chips, timeout=1.0):
        self.chips, self.timeout = chips, timeout

    def at(self, address):
        found = [one for chip in self.chips for one in chip.heard() if one.address == address]
        if not found:
            raise OSError(errno.EREMOTEIO, "nobody has acknowledged")
        for chip in found:
            if chip.stuck_until > time.monotonic():
                time.sleep(self.timeout)
                raise OSError(errno.ETIMEDOUT, "the clock is held low")
        return found

    def write(self, address, data):
        for chip in self.at(address):
            chip.write(data)

    def read(self, address, count):
        """Those who answer together pull the line low together."""
        said = bytes([0xFF]) * count
        for chip in self.at(address):
            said = bytes(one & other for one, other in zip(said, chip.read(count)))
        return said
