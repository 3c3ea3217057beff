# cython: freethreading_compatible=True
"""I2C behind the `Bus` struct: one native thread per bus reads its devices, each at its own period, and keeps the
answers for the tick. SPI (cext/lines/spi.pyx) has the same thread, without multiplexers and set-up.

    round     all due exchanges, place by place, beginning with the open one: with n channels of a multiplexer in use
              this takes n - 1 switches, the minimum
    answer    a frame with the data, time-stamped before the exchange; a ring keeps the newest for the tick
    failure   counted, and reported in a frame; the device's settings are checked before the next exchange. After three
              in a row the device is lost, and retried every 100 ms
    set-up    repeated after a loss, one write at a time, while other devices are read
    return    a lost device is first identified, since another may have been plugged in
    check     a register is compared ten times a second, since a device that lost its supply for a moment may use other
              ranges

An exchange that hangs delays the devices of its bus until the adapter gives it up, and no other thread.
"""

import os

from libc.string cimport memcmp, memcpy, memset
from libc.stdlib cimport calloc, free

from cext.abi cimport EXTENDED, Frame
from cext.atomics cimport load_i32, load_u64, store_i32, store_u64
from cext.lines.i2c_answers cimport TROUBLE, answer_id
from cext.ring.newest_ring cimport forget, pull, push
from cext.clock.deadline_clock cimport monotonic
from cext.posix cimport pthread_join
from cext.threads cimport be_called, doze, start_thread, wake

cdef int64_t RETRY = 100000000          # ns between attempts to reach a lost device
cdef int64_t CHECK = 100000000          # ns between checks of a device's settings
cdef int64_t REST_LIMIT = 1000000000    # ns of sleep
cdef size_t STACK = 256 << 10           # bytes
cdef int FAILURE_LIMIT = 3              # failures in a row until a device is lost
cdef int SETTINGS_LOST = -1             # error of a device that has lost its settings
cdef int WRONG_DEVICE = -2              # error of a device of another kind
CHANNELS = 8                            # channels of a multiplexer
STATES = ("fine", "setting up", "lost")


cdef enum:
    FIRST_MUX = 0x70


cdef inline int mux_of(int place) noexcept nogil:
    """Return the number of the multiplexer of a place."""
    return (place - 1) // 8


cdef int i2c_receive(void *context, Frame *frames, int capacity) noexcept nogil:
    cdef Inbox *inbox = <Inbox *>context
    cdef int count = 0
    while count < capacity and pull(&inbox.ring, &frames[count]):
        frames[count].time = max(frames[count].time - inbox.began, 0)
        count += 1
    return count


cdef int i2c_send(void *context, const Frame *frames, int count) noexcept nogil:
    return count


cdef void i2c_begin(void *context, int64_t began) noexcept nogil:
    cdef Inbox *inbox = <Inbox *>context
    forget(&inbox.ring)
    inbox.began = began
    store_i32(&inbox.runs, inbox.runs + 1)


cdef class I2cAdapter:
    """Carrier of exchanges: cext.lines.i2c_adapters for Linux, cext.lines.i2c_memory in memory."""

    def exchange_bytes(self, int address, int register, bytes data=None, int count=0) -> bytes:
        """Write `data`, or read and return `count` bytes; for tests and tools.

        Raises OSError without an acknowledge.
        """
        cdef uint8_t[READ_LIMIT] buffer
        cdef int error
        cdef bint reads = data is None
        cdef int size = count if data is None else <int>len(data)
        if not 0 <= count <= READ_LIMIT or (data is not None and len(data) > READ_LIMIT):
            raise ValueError("an exchange has at most %d bytes" % READ_LIMIT)
        if data is not None:
            memcpy(buffer, <const char *>data, len(data))
        with nogil:
            error = self.adapter.exchange(self.adapter.context, <uint8_t>address, register, reads, buffer, size)
        if error:
            raise OSError(error, os.strerror(error))
        return bytes(buffer[:count])

    def shift(self, int address, int word, bytes data) -> bytes:
        """Send bytes on SPI, and return those received meanwhile. Raises OSError.

        address : chip select; word : bytes of a frame
        """
        cdef uint8_t[READ_LIMIT] buffer
        cdef int error
        cdef int count = <int>len(data)
        if not 0 < word <= count <= BYTES or count % word:
            raise ValueError("a transfer has at most %d bytes, in whole frames" % BYTES)
        memcpy(buffer, <const char *>data, count)
        with nogil:
            error = self.adapter.exchange(self.adapter.context, <uint8_t>address, word, True, buffer, count)
        if error:
            raise OSError(error, os.strerror(error))
        return bytes(buffer[:count])


cdef class I2cBus:
    """Devices of one bus, and the thread that reads them.

    adapter : I2cAdapter
    name : name of the bus, for messages
    kind : of the bus, for the name of the thread

    end : the BusEnd
    """

    def __cinit__(self):
        self.inbox = <Inbox *>calloc(1, sizeof(Inbox))
        if self.inbox == NULL:
            raise MemoryError
        memset(self.inbox, 0, sizeof(Inbox))                        # touch every page before the tick does
        self.end = BusEnd()
        self.end.bus.receive, self.end.bus.send, self.end.bus.begin = i2c_receive, i2c_send, i2c_begin
        self.end.bus.context = self.inbox
        self.end.owner = self

    def __init__(self, I2cAdapter adapter, str name="", str kind="i2c"):
        self.adapter, self.name, self.tables, self.open = adapter, name, [], -1
        self.thread_name = f"tickwork-{kind}".encode()
        self.called = self.thread_name

    def __dealloc__(self):
        self.stop()
        free(self.members)
        free(self.cycles)
        free(self.exchanges)
        free(self.setups)
        free(self.inbox)

    def add(self, int place, int address, set_up=(), check=None, rounds=(), identity=()) -> None:
        """Add a device, which has been set up, before `start`.

        place : number of its bus segment; address : address of the device
        set_up : list of (address, register, bytes, s to wait), to repeat after a loss
        check : (register, bytes) that reads back while the device is set up, or None
        rounds : list of (period in s, minimum s between exchanges, exchanges as (number, address, steps, bytes to
            append to the answer)); a step is (register, number of bytes to read) or (register, bytes to write), on SPI
            (bytes of a frame, bytes to send, True), which receives as many
        identity : list of (register, byte, mask) that identify the device after a loss, in the bits where the mask is 1
        """
        if self.running:
            raise ValueError("devices must be added before start")
        if not 0 <= place <= CHANNELS * MUXES or not 0 <= address < 0x80:
            raise ValueError("invalid place %d or address %d" % (place, address))
        for period, settle, exchanges in rounds:
            if not (period > 0.0 and settle >= 0.0 and len(exchanges) > 0):
                raise ValueError("a round needs a period above 0 and exchanges")
            for number, _, steps, appended in exchanges:
                sizes = [what if isinstance(what, int) else len(what) for _, what, *_ in steps]
                read = sum(size for size, (_, what, *duplex) in zip(sizes, steps) if duplex or isinstance(what, int))
                longest = max((size if isinstance(what, int) else 2 * size for size, (_, what, *_) in zip(sizes, steps)),
                    default=0)
                if (not 0 <= number < TROUBLE or not 0 < len(steps) <= STEPS or longest > READ_LIMIT
                        or len(appended) > BYTES):
                    raise ValueError("an exchange has a number below 15, and at most %d steps of %d bytes"
                                     % (STEPS, READ_LIMIT))
                if read + len(appended) > 64:
                    raise ValueError("a reply has at most 64 bytes, not %d" % (read + len(appended)))
        if any(len(data) > BYTES for _, _, data, _ in set_up) or (check is not None and not 0 < len(check[1]) <= BYTES):
            raise ValueError("at most %d bytes are written in one step, or checked" % BYTES)
        if len(identity) > IDENTITIES:
            raise ValueError("at most %d registers identify a device" % IDENTITIES)
        self.tables.append((place, address, tuple(set_up), check, tuple(rounds), tuple(identity)))

    cdef int lay_out(self) except -1:
        cdef int cycle = 0
        cdef int exchange = 0
        cdef int setup = 0
        cdef Member *member
        cdef Exchange *asked
        cdef bytes data
        rounds = [one for table in self.tables for one in table[4]]
        free(self.members); free(self.cycles); free(self.exchanges); free(self.setups)
        self.count = len(self.tables)
        self.members = <Member *>calloc(max(1, self.count), sizeof(Member))
        self.cycles = <Cycle *>calloc(max(1, len(rounds)), sizeof(Cycle))
        self.exchanges = <Exchange *>calloc(max(1, sum(len(one[2]) for one in rounds)), sizeof(Exchange))
        self.setups = <SetUp *>calloc(max(1, sum(len(table[2]) for table in self.tables)), sizeof(SetUp))
        if self.members == NULL or self.cycles == NULL or self.exchanges == NULL or self.setups == NULL:
            raise MemoryError
        for index, (place, address, set_up, check, own, identity) in enumerate(self.tables):
            member = &self.members[index]
            member.place, member.address = place, address
            member.trouble = answer_id(<uint32_t>(place << 8 | address), TROUBLE)
            if place:
                self.present[mux_of(place)] = True
            member.first_setup, member.setups, member.setups_sent = setup, len(set_up), len(set_up)
            for at, register, data, wait in set_up:
                self.setups[setup].address, self.setups[setup].register = at, register
                self.setups[setup].count = len(data)
                memcpy(self.setups[setup].data, <const char *>data, len(data))
                self.setups[setup].wait = round(wait * 1e9)
                setup += 1
            if check is not None:
                data = check[1]
                member.check_register, member.checked = check[0], len(data)
                memcpy(member.expected, <const char *>data, len(data))
            member.identities = len(identity)
            for at, (register, value, mask) in enumerate(identity):
                member.identity[at].register, member.identity[at].value = register, value
                member.identity[at].mask = mask
            member.first_cycle, member.cycles = cycle, len(own)
            for period, settle, exchanges in own:
                self.cycles[cycle].member, self.cycles[cycle].first = index, exchange
                self.cycles[cycle].count = len(exchanges)
                self.cycles[cycle].period, self.cycles[cycle].settle = round(period * 1e9), round(settle * 1e9)
                cycle += 1
                for number, at, steps, data in exchanges:
                    asked = &self.exchanges[exchange]
                    asked.id = answer_id(<uint32_t>(place << 8 | address), number)
                    asked.address, asked.steps, asked.appended = at, len(steps), len(data)
                    memcpy(asked.tail, <const char *>data, len(data))
                    for step, (register, what, *duplex) in enumerate(steps):
                        load_step(&asked.step[step], register, what, bool(duplex))
                    exchange += 1
        return 0

    def start(self, int priority=0) -> None:
        """Start the thread. priority : of SCHED_FIFO if granted, 0 for an ordinary thread"""
        cdef int failed, index
        cdef int64_t now
        if self.running:
            return
        self.lay_out()
        now = monotonic()
        for index in range(self.count):
            self.members[index].next_check = now + CHECK
        for index in range(sum(len(table[4]) for table in self.tables)):
            self.cycles[index].due = now
        self.origin, self.ended, self.run = now, 0, self.inbox.runs
        self.open, self.leave, self.bell, self.priority = -1, 0, 0, priority
        failed = start_thread(&self.thread, enter, <void *>self, STACK)
        if failed:
            raise OSError(failed, "cannot start the thread of an I2C bus")
        self.running = True

    def stop(self) -> None:
        """Stop the thread. Earlier answers can still be received."""
        if not self.running:
            return
        self.running = False
        store_i32(&self.leave, 1)
        store_i32(&self.bell, 1)
        wake(&self.bell)
        with nogil:
            pthread_join(self.thread, NULL)
        self.ended = monotonic()

    def begin(self, int64_t began) -> None:
        """Discard earlier answers, and time frames from `began`, in ns of CLOCK_MONOTONIC."""
        i2c_begin(self.inbox, began)

    @property
    def counts(self) -> dict[str, Any]:
        """Counts of the thread, by name.

        switches, rounds : of multiplexers; of due exchanges
        overflows : frames overwritten unread
        devices : for each, in the order added: state, answers, rate (Hz of its first round), failures, losses, returns,
            and error: errno of the last failure, -1 for lost settings, -2 for a chip of another kind, or None
        """
        cdef int index
        cdef double seconds = max(1, (self.ended or monotonic()) - self.origin) * 1e-9
        cdef Member *member
        devices = []
        for index in range(self.count):
            member = &self.members[index]
            devices.append({
                "state": STATES[load_i32(&member.state)], "answers": load_u64(&member.answers),
                "rate": load_u64(&member.samples) / seconds, "failures": load_u64(&member.failures),
                "losses": load_u64(&member.losses), "returns": load_u64(&member.returns),
                "error": load_i32(&member.error) or None})
        return {
            "switches": load_u64(&self.switches), "rounds": load_u64(&self.rounds),
            "overflows": self.inbox.ring.skipped,
            "devices": devices}

    # The thread

    cdef void serve(self) noexcept nogil:
        cdef int64_t due
        be_called(self.called, self.priority)
        while not load_i32(&self.leave):
            due = self.run_due(monotonic())
            doze(&self.bell, due)

    cdef int64_t run_due(self, int64_t now) noexcept nogil:
        """Run all due exchanges. Returns when the next one is due, in ns of CLOCK_MONOTONIC."""
        cdef int64_t next = now + REST_LIMIT
        cdef int64_t due
        cdef int index, place, mux
        cdef int first = self.open
        cdef bint any = False
        if load_i32(&self.inbox.runs) != self.run:
            self.run = load_i32(&self.inbox.runs)
            for index in range(self.count):
                self.members[index].failures_before = self.members[index].failures
        for index in range(self.count):
            any = any or self.due_of(&self.members[index]) <= now
        if any:
            store_u64(&self.rounds, self.rounds + 1)
            self.run_place(0, now)                              # reached with any open channel
            if first > 0:
                self.run_place(first, now)
                for place in range(1 + 8 * mux_of(first), 9 + 8 * mux_of(first)):
                    if place != first:
                        self.run_place(place, now)
            for mux in range(MUXES):
                if self.present[mux] and (first <= 0 or mux != mux_of(first)):
                    for place in range(1 + 8 * mux, 9 + 8 * mux):
                        self.run_place(place, now)
        for index in range(self.count):
            due = self.due_of(&self.members[index])
            next = due if due < next else next
        return next

    cdef void run_place(self, int place, int64_t now) noexcept nogil:
        cdef int index
        for index in range(self.count):
            if self.members[index].place == place and self.due_of(&self.members[index]) <= now:
                self.run_member(&self.members[index], now)

    cdef int64_t due_of(self, const Member *member) noexcept nogil:
        """Return when the device needs attention next."""
        cdef int64_t due
        cdef int index
        if member.state != FINE:
            return member.due
        due = member.next_check if member.checked else monotonic() + REST_LIMIT
        for index in range(member.first_cycle, member.first_cycle + member.cycles):
            due = self.cycles[index].due if self.cycles[index].due < due else due
        return due

    cdef void run_member(self, Member *member, int64_t now) noexcept nogil:
        cdef Cycle *cycle
        cdef int index
        if member.state == LOST:
            self.begin_set_up(member, now)
        if member.state == SETTING_UP:
            self.continue_set_up(member, now)
            return
        if member.checked and (member.unverified or member.next_check <= now) and not self.has_settings(member, now):
            return
        for index in range(member.first_cycle, member.first_cycle + member.cycles):
            cycle = &self.cycles[index]
            if cycle.due <= now and not self.run_cycle(member, cycle, now):
                return

    cdef void begin_set_up(self, Member *member, int64_t now) noexcept nogil:
        member.setups_sent = 0
        member.due = now
        store_i32(&member.state, SETTING_UP)

    cdef void continue_set_up(self, Member *member, int64_t now) noexcept nogil:
        """Write the next step of its set-up; after the last one, resume."""
        cdef SetUp *setup
        cdef int index, error
        if member.setups_sent < member.setups:
            setup = &self.setups[member.first_setup + member.setups_sent]
            error = self.exchange(member, setup.address, setup.register, False, setup.data, setup.count)
            if error != 0:
                self.fail(member, error, now)
                return
            member.setups_sent += 1
            member.due = monotonic() + setup.wait
            if member.setups_sent < member.setups or setup.wait > 0:
                return
        if not self.has_identity(member, now):
            return
        for index in range(member.first_cycle, member.first_cycle + member.cycles):
            self.cycles[index].at = 0
            self.cycles[index].due = now
        member.consecutive_failures = 0
        member.unverified = True                                       # its settings are checked first
        member.next_check = now
        store_i32(&member.state, FINE)
        if member.losses > member.returns:
            store_u64(&member.returns, member.returns + 1)
        self.log(member, now)

    cdef bint has_identity(self, Member *member, int64_t now) noexcept nogil:
        """Return whether a device that was set up again has the expected identity."""
        cdef uint8_t[READ_LIMIT] reply
        cdef int index
        cdef int error = 0
        for index in range(member.identities):
            error = self.exchange(member, member.address, member.identity[index].register, True, reply, 1)
            if error == 0 and (reply[0] & member.identity[index].mask) != member.identity[index].value:
                error = WRONG_DEVICE
            if error != 0:
                self.fail(member, error, now)
                return False
        return True

    cdef bint has_settings(self, Member *member, int64_t now) noexcept nogil:
        """Return whether a device still has its settings. If not, its set-up begins again."""
        cdef uint8_t[READ_LIMIT] reply
        cdef int error = self.exchange(member, member.address, member.check_register, True, reply, member.checked)
        if error != 0:
            self.fail(member, error, now)
            return False
        member.next_check = now + CHECK
        if memcmp(reply, member.expected, member.checked) == 0:
            member.unverified = False
            return True
        self.fail(member, SETTINGS_LOST, now)
        if member.state == FINE:
            self.begin_set_up(member, now)
        return False

    cdef bint run_cycle(self, Member *member, Cycle *cycle, int64_t now) noexcept nogil:
        cdef Exchange *asked = &self.exchanges[cycle.first + cycle.at]
        cdef Frame frame
        cdef uint8_t[READ_LIMIT] written
        cdef int index, error
        cdef int length = 0
        # Missed exchanges are skipped. Devices of one period stay in step, so that one round of switches serves all of
        # them.
        cycle.due = self.origin + ((now - self.origin) // cycle.period + 1) * cycle.period
        error = self.switch_to(member.place)                        # before the time stamp of the answer
        if error != 0:
            self.fail(member, error, now)
            return False
        memset(&frame, 0, sizeof(Frame))
        frame.time = -1
        for index in range(asked.steps):
            if asked.step[index].reads:
                memcpy(&frame.data[length], asked.step[index].data, min(asked.step[index].count, BYTES))   # SPI
                if frame.time < 0:
                    frame.time = monotonic()
                error = self.exchange(member, asked.address, asked.step[index].register, True, &frame.data[length],
                    asked.step[index].count)
                length += asked.step[index].count
            else:
                memcpy(written, asked.step[index].data, asked.step[index].count)
                error = self.exchange(member, asked.address, asked.step[index].register, False, written,
                    asked.step[index].count)
            if error != 0:
                self.fail(member, error, now)
                return False
        memcpy(&frame.data[length], asked.tail, asked.appended)
        frame.id, frame.length = asked.id, <uint8_t>(length + asked.appended)
        cycle.at = (cycle.at + 1) % cycle.count
        if cycle.settle > 0:
            cycle.due = max(cycle.due, monotonic() + cycle.settle)
        member.consecutive_failures = 0
        store_u64(&member.answers, member.answers + 1)
        if cycle == &self.cycles[member.first_cycle]:
            store_u64(&member.samples, member.samples + 1)
        if length + asked.appended > 0:
            push(&self.inbox.ring, &frame)
        return True

    cdef int exchange(self, Member *member, uint8_t address, int register, bint reads, uint8_t *data,
            int count) noexcept nogil:
        cdef int error = self.switch_to(member.place)
        if error == 0:
            error = self.adapter.adapter.exchange(self.adapter.adapter.context, address, register, reads, data, count)
        return error

    cdef int switch_to(self, int place) noexcept nogil:
        """Open one channel only. After a failure the state is unknown, and the next call writes to all multiplexers."""
        cdef int mux, error
        cdef int wanted = mux_of(place)
        cdef uint8_t mask
        if place == 0 or place == self.open:
            return 0
        for mux in range(MUXES):
            if self.present[mux] and mux != wanted and (self.open < 0 or (self.open > 0 and mux == mux_of(self.open))):
                mask = 0
                error = self.adapter.adapter.exchange(self.adapter.adapter.context, <uint8_t>(FIRST_MUX + mux), -1,
                    False, &mask, 1)
                if error != 0:
                    self.open = -1
                    return error
                store_u64(&self.switches, self.switches + 1)
        mask = <uint8_t>(1 << (place - 1) % 8)
        error = self.adapter.adapter.exchange(self.adapter.adapter.context, <uint8_t>(FIRST_MUX + wanted), -1, False,
            &mask, 1)
        self.open = place if error == 0 else -1
        if error == 0:
            store_u64(&self.switches, self.switches + 1)
        return error

    cdef void fail(self, Member *member, int error, int64_t now) noexcept nogil:
        store_i32(&member.error, error)
        store_u64(&member.failures, member.failures + 1)
        member.unverified = True
        member.consecutive_failures += 1
        if self.open > 0 and member.place > 0:                      # the multiplexer may have been reset
            self.open = -1
        if member.state == SETTING_UP or member.consecutive_failures >= FAILURE_LIMIT:
            if member.losses == member.returns:
                store_u64(&member.losses, member.losses + 1)
            member.due = now + RETRY
            store_i32(&member.state, LOST)
        elif member.next_check <= now:
            member.next_check = now + RETRY // 10
        self.log(member, now)

    cdef void log(self, const Member *member, int64_t now) noexcept nogil:
        cdef Frame frame
        cdef uint32_t count = <uint32_t>(member.failures - member.failures_before)
        memset(&frame, 0, sizeof(Frame))
        frame.time, frame.id, frame.length = now, member.trouble, 5
        frame.data[0] = member.state != FINE
        frame.data[1], frame.data[2] = <uint8_t>(count & 0xFF), <uint8_t>(count >> 8 & 0xFF)
        frame.data[3], frame.data[4] = <uint8_t>(count >> 16 & 0xFF), <uint8_t>(count >> 24)
        push(&self.inbox.ring, &frame)


cdef void *enter(void *context) noexcept nogil:
    (<I2cBus>context).serve()
    return NULL


cdef int load_step(Step *step, int register, object what, bint duplex) except -1:
    cdef bytes data
    step.reads, step.register = duplex or isinstance(what, int), register
    if isinstance(what, int):
        step.count = what
    else:
        data = what
        step.count = len(data)
        memcpy(step.data, <const char *>data, len(data))
    return 0
