# cython: freethreading_compatible=True
"""I2C bus in memory, for tests: chips of 256 registers, and multiplexers.

A register holds one byte and is written and read from any thread. Chips that reply at one address pull the line low
together, so their bits are combined by AND. A chip may be absent, or slow, as with clock stretching.
"""

from libc.errno cimport EREMOTEIO, ETIMEDOUT
from libc.stdint cimport int64_t, uint8_t, uint64_t
from libc.stdlib cimport calloc, free

from cext.atomics cimport load_u64, store_u64
from cext.lines.i2c cimport I2cAdapter
from cext.posix cimport CLOCK_MONOTONIC, clock_nanosleep, timespec

cdef enum:
    CHIPS = 32
    REGISTERS = 256
    FIRST_MUX = 0x70
    MUXES = 8

cdef struct Chip:
    int place                   # 0 on the bus itself
    uint8_t address
    bint wide                   # registers of two bytes, most significant first
    bint absent
    bint stuck                  # an exchange with it times out
    int64_t slow                # ns of each exchange
    uint64_t reads
    uint64_t writes
    uint8_t registers[2 * REGISTERS]

cdef struct Chips:
    int count
    Chip chip[CHIPS]
    bint muxes[MUXES]
    uint8_t masks[MUXES]        # open channels
    uint64_t exchanges
    uint64_t switches


cdef inline bint reached(const Chips *chips, const Chip *chip) noexcept nogil:
    cdef int place = chip.place - 1
    return not chip.absent and (chip.place == 0 or (chips.muxes[place // 8]
        and chips.masks[place // 8] >> place % 8 & 1))


cdef int carry(void *context, uint8_t address, int register, bint reads, uint8_t *data, int count) noexcept nogil:
    cdef Chips *chips = <Chips *>context
    cdef Chip *chip
    cdef timespec nap
    cdef int index, k, at
    cdef bint answered = False
    store_u64(&chips.exchanges, chips.exchanges + 1)
    if FIRST_MUX <= address < FIRST_MUX + MUXES and chips.muxes[address - FIRST_MUX]:
        if register >= 0:
            return EREMOTEIO
        if reads and count > 0:
            data[0] = chips.masks[address - FIRST_MUX]
        elif count > 0:
            chips.masks[address - FIRST_MUX] = data[count - 1]      # the last of several bytes counts
            store_u64(&chips.switches, chips.switches + 1)
        return 0
    for index in range(chips.count):
        chip = &chips.chip[index]
        if chip.address != address or not reached(chips, chip):
            continue
        if chip.slow > 0:
            nap.tv_sec, nap.tv_nsec = chip.slow // 1000000000, chip.slow % 1000000000
            clock_nanosleep(CLOCK_MONOTONIC, 0, &nap, NULL)
        if chip.stuck:
            return ETIMEDOUT
        for k in range(count if register >= 0 else 0):
            at = (register * 2 + k if chip.wide else register + k) % (2 * REGISTERS if chip.wide else REGISTERS)
            if reads:
                data[k] = data[k] & chip.registers[at] if answered else chip.registers[at]
            else:
                chip.registers[at] = data[k]
        if reads:
            store_u64(&chip.reads, chip.reads + 1)
        else:
            store_u64(&chip.writes, chip.writes + 1)
        answered = True
    return 0 if answered else EREMOTEIO


cdef class MemoryI2c(I2cAdapter):
    """Adapter of an I2C bus in memory. muxes : addresses of its multiplexers"""

    cdef Chips *chips

    def __cinit__(self, muxes=()):
        self.chips = <Chips *>calloc(1, sizeof(Chips))
        if self.chips == NULL:
            raise MemoryError
        for address in muxes:
            self.chips.muxes[address - FIRST_MUX] = True
        self.adapter.exchange, self.adapter.context = carry, self.chips

    def __dealloc__(self):
        free(self.chips)

    def add(self, int address, int place=0, bint wide=False) -> int:
        """Add a chip with all registers 0.

        wide : registers of two bytes, most significant first. Returns its number.
        """
        cdef Chip *chip
        if self.chips.count == CHIPS:
            raise ValueError("at most %d chips" % CHIPS)
        chip = &self.chips.chip[self.chips.count]
        chip.address, chip.place, chip.wide = address, place, wide
        self.chips.count += 1
        return self.chips.count - 1

    cdef Chip *of(self, int number) except NULL:
        if not 0 <= number < self.chips.count:
            raise IndexError(number)
        return &self.chips.chip[number]

    def write(self, int number, int register, bytes data) -> None:
        """Set registers of a chip."""
        cdef Chip *chip = self.of(number)
        cdef int width = 2 if chip.wide else 1
        cdef int k
        for k in range(len(data)):
            chip.registers[(register * width + k) % (width * REGISTERS)] = data[k]

    def read(self, int number, int register, int count=1) -> bytes:
        """Return `count` bytes of the registers of a chip."""
        cdef Chip *chip = self.of(number)
        cdef int width = 2 if chip.wide else 1
        return bytes([chip.registers[(register * width + k) % (width * REGISTERS)] for k in range(count)])

    def clear(self, int number) -> None:
        """Set every register to 0, as after power-on."""
        cdef Chip *chip = self.of(number)
        cdef int k
        for k in range(2 * REGISTERS):
            chip.registers[k] = 0

    def behave(self, int number, *, absent=None, stuck=None, slow=None) -> None:
        """Set faults. absent : no acknowledge; stuck : exchanges time out; slow : s per exchange"""
        cdef Chip *chip = self.of(number)
        if absent is not None:
            chip.absent = absent
        if stuck is not None:
            chip.stuck = stuck
        if slow is not None:
            chip.slow = round(slow * 1e9)

    def of_chip(self, int number) -> tuple[int, int]:
        """Return (reading exchanges, writing exchanges) of a chip."""
        cdef Chip *chip = self.of(number)
        return load_u64(&chip.reads), load_u64(&chip.writes)

    @property
    def switches(self) -> int:
        """Number of writes to multiplexers."""
        return load_u64(&self.chips.switches)

    @property
    def exchanges(self) -> int:
        """Number of exchanges."""
        return load_u64(&self.chips.exchanges)
