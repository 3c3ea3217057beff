"""The chips of an I2C bus as smbus2 reaches them, through whatever multiplexers: to set them up, and to say which there
are.
"""

import errno

from blocks.i2c import CHANNELS, MUX

FIRST, LAST = 0x08, 0x77  # addresses that a device may have
# memories, which a write without data could harm: a byte is read of these
FRAGILE = {*range(0x30, 0x38), *range(0x50, 0x60)}


class NoAnswer(Exception):
    """errno; address : that did not answer; mux : whether it was a multiplexer's"""

    def __init__(self, error, address, mux=False):
        super().__init__(f"{address:#04x}: {error}")
        self.errno, self.address, self.mux = error.errno, address, mux


class Chips:
    """wires : smbus2.SMBus, or what has its methods"""

    def __init__(self, wires):
        self.wires = wires
        self.open = (0, 0)  # multiplexer and channel that are open; 0: none that we have opened

    def close(self):
        self.wires.close()

    def read(self, address, register, count):
        """A word, on the wire two bytes, is what an adapter without blocks reads of registers that are two bytes
        wide.
        """
        with answered(address):
            if count == 1:
                return bytes((self.wires.read_byte_data(address, register),))
            if count == 2:
                return self.wires.read_word_data(address, register).to_bytes(2, "little")
            return bytes(self.wires.read_i2c_block_data(address, register, count))

    def write(self, address, register, data):
        with answered(address):
            if len(data) == 1:
                self.wires.write_byte_data(address, register, data[0])
            elif len(data) == 2:
                self.wires.write_word_data(address, register, int.from_bytes(data, "little"))
            else:
                self.wires.write_i2c_block_data(address, register, list(data))

    def probe(self, address):
        """NoAnswer where nobody is at an address."""
        with answered(address):
            if address in FRAGILE:
                self.wires.read_byte(address)
                return
            try:
                self.wires.write_quick(address)
            except OSError as error:
                if error.errno != errno.EOPNOTSUPP:
                    raise
                self.wires.read_byte(address)

    def switch(self, mux, channel):
        """Open one channel and no other; mux 0: none."""
        if self.open == (mux, channel):
            return
        if self.open[0] and self.open[0] != mux:
            self.select(self.open[0], 0)
        self.open = (0, 0)
        if mux:
            self.select(mux, 1 << channel)
            self.open = (mux, channel)

    def select(self, mux, mask):
        try:
            with answered(mux):
                self.wires.write_byte(mux, mask)
        except NoAnswer as error:
            error.mux = True
            raise

    def leave(self):
        """Close what is open."""
        self.switch(0, 0)

    def answering(self, outside=False):
        """Addresses that answer where we are, those of the bus itself among them. outside : on the bus itself alone"""
        if outside:
            try:
                self.switch(0, 0)
            except NoAnswer:
                pass
        found = []
        for address in range(FIRST, LAST + 1):
            try:
                self.probe(address)
                found.append(address)
            except NoAnswer as error:
                if error.errno == errno.EBUSY:  # a driver of the kernel has it
                    found.append(address)
                elif error.errno in (errno.ETIMEDOUT, errno.EAGAIN):
                    break  # a bus that hangs would take seconds for each
        return found


class answered:
    """Turns an OSError into a NoAnswer."""

    def __init__(self, address):
        self.address = address

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        if isinstance(error, OSError):
            raise NoAnswer(error, self.address) from None


class KnownChips:
    """What the chips on a bus are, as far as registers tell. chips : Chips"""

    # address: (register, {value: name}, mask); an address with several is asked for each
    REGISTERS = {
        0x68: (
            (0x75, {0x71: "MPU-9250", 0x73: "MPU-9255", 0x68: "MPU-6050", 0x70: "MPU-6500", 0x47: "ICM-42688-P"}, 0xFF),
            (0x00, {0xEA: "ICM-20948"}, 0xFF),
        ),
        0x0C: ((0x00, {0x48: "AK8963"}, 0xFF), (0x01, {0x09: "AK09916"}, 0xFF)),
        0x2A: ((0x1F, {0x0F: "NAU7802"}, 0x0F),),
    }
    REGISTERS[0x69] = REGISTERS[0x68]
    GUESSES = {
        **{address: "ADS1115 or ADS1015" for address in range(0x48, 0x4C)},
        **{address: "TCA9548A multiplexer" for address in range(MUX, MUX + 8)},
    }

    def __init__(self, chips):
        self.chips = chips

    def name(self, address):
        """(name, how it is known): "" twice where nothing is."""
        for register, values, mask in self.REGISTERS.get(address, ()):
            try:
                said = self.chips.read(address, register, 1)[0]
            except NoAnswer:
                return "", ""
            if said & mask in values:
                return values[said & mask], f"register {register:#04x} is {said:#04x}"
        return (self.GUESSES[address], "by its address") if address in self.GUESSES else ("", "")

    def everywhere(self):
        """Every chip there is: [(mux, channel, address, name, how)], mux 0 for the bus itself. Those of the bus are
        told once.
        """
        self.chips.leave()
        here = self.chips.answering()
        muxes = [address for address in here if MUX <= address < MUX + 8]
        for mux in muxes:
            self.chips.select(mux, 0)  # what a run before has left open
        here = [address for address in self.chips.answering()]
        found = [(0, 0, address, *self.name(address)) for address in here]
        for mux in muxes:
            for channel in range(CHANNELS):
                try:
                    self.chips.switch(mux, channel)
                except NoAnswer:
                    break
                found += [
                    (mux, channel, address, *self.name(address))
                    for address in self.chips.answering()
                    if address not in here
                ]
        self.chips.leave()
        return found


def in_hex(addresses):
    return ", ".join(f"{address:#04x}" for address in addresses) or "nobody"
