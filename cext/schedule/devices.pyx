# cython: freethreading_compatible=True
"""Devices of a schedule and their buses: the part of a tick that communicates.

    receive    drain every bus, and offer each frame to its devices
    watch      check for silent devices and faults
    command    encode the frames of each device; nothing is sent if one fails
    transmit   send the frames

For arming and the safe stop, frames are encoded at compile time, and replies to them are counted.
"""

from libc.stdint cimport uint8_t, uintptr_t
from libc.math cimport fabs, isfinite
from libc.stdlib cimport calloc, free
from libc.string cimport memcmp, memcpy, memset

from cext.abi cimport (
    ANSWERED, AUTHORITY, BUS_ERROR, COMMANDED, DEVICE_FAULT, DT, ESTOP, EXTENDED, FENCED, FOREIGN, FOREIGN_COMMAND,
    FRAME_BYTES, IMPLAUSIBLE, MALFORMED, MOVING, OK, PERIOD, PRESSED, SILENT, TAKEN, TICK,
)
from cext.bus.batch cimport load_batch
from cext.clock.histogram cimport add, summary
from cext.clock.deadline_clock cimport monotonic
from cext.safety.shared_state cimport FENCED_FOR_GOOD, FRAME, RECEIVED, commit, load_i32, reserve
from cext.safety.drive_state cimport ACTIVE, DAMPED, OUT, RETURNING, enter, forget_state
from cext.safety.event_template cimport EventTemplate
from cext.safety.motion_watch cimport POSITION, blame
from cext.safety.speed_bands cimport SpeedBands
from cext.safety.thresholds cimport ARMING_LIMIT, FADE_IN, STOP_LIMIT, TRAVEL_MARGIN, ZERO_LIMIT
from cext.safety.zeroing cimport (
    ZERO_KEPT, ZERO_LOST, ZERO_SET, ZERO_UNKNOWN, begin_rest, begin_zero, forget_zero, judge_zero, may_be_zeroed,
    note_command, note_position, repeat_zero,
)
from cext.clock.stopwatch cimport COMMAND, lap

from cext.schedule.kernel_table import address, words

EVENTS = {                          # of a device, and its text
    ZEROED: ("zero", "the present position of the drive is its zero"),
    ZERO_REFUSED: ("warning", "the zero was not set: it can be set after 0.1 s of zero torque and rest"),
    ZERO_NOT_SET: ("warning", "the drive has not confirmed its zero; the earlier one is in force"),
    TAKEN_OUT: ("drive", "taken out; {path}.disabled=false arms it again"),
    RETURNED: ("drive", "armed again; its commands fade in"),
    NOT_RETURNED: (
        "warning",
        "not armed again: it does not reply, it reports a fault, or the angle of its joint is out of range or "
        "ambiguous"),
}


cdef int64_t SILENT_ROUND = 500000000    # ns between frames to a drive that is taken out and does not reply
cdef int64_t POWER_LOSS = 100000000      # ns without a reply of a drive, after which it may have restarted
cdef int64_t RETURN_DELAY = 20000000     # ns without frames to a drive before it is armed again, for late replies


cdef class Devices:
    """Devices of a `graph.Schedule`.

    Parameters
    ----------
    schedule : graph.Schedule
    ends : BusEnd, one for each of schedule.buses
    memory : the arena, an array of doubles that outlives this object
    """

    def __init__(self, schedule, ends, memory):
        if len(ends) != len(schedule.buses):
            raise ValueError("the schedule has %d buses, but %d bus ends were given" % (len(schedule.buses), len(ends)))
        self.schedule, self.memory, self.keep = schedule, memory, []
        self.arena = <double *><uintptr_t>memory.ctypes.data
        self.ends = list(ends)
        self.bus_count = len(ends)
        self.bus_ends = <void **>calloc(max(1, len(ends)), sizeof(void *))
        self.rounds = <int32_t *>calloc(max(1, len(ends)), sizeof(int32_t))
        for index, (end, medium) in enumerate(zip(self.ends, schedule.media)):
            self.bus_ends[index] = <void *>(<BusEnd?>end)
            self.rounds[index] = 1 if medium == "can" else DEEPEST
        self.drives = DriveWatch(schedule)
        self.warnings = DriveWarnings(schedule)
        self.fade = FADE_IN * 1e-9
        self.page = NULL
        self.load()

    def __dealloc__(self):
        for index in range(self.count):
            free(self.devices[index].latency)
        free(self.devices); free(self.outgoing); free(self.templates)
        free(self.outgoing_count); free(self.bus_ends); free(self.rounds)

    cdef void reset(self):
        """Restore the state before the first arming. Frames from before are discarded, as they are no replies."""
        cdef int index
        if self.ran:
            self.discard()
        self.ran = True
        self.now = 0
        for index in range(self.count):
            forget_zero(&self.devices[index].zeroing)
            forget_state(&self.devices[index].drive, self.arena)
            self.devices[index].fades_from = -1
            self.devices[index].reply_time = self.devices[index].replies = self.devices[index].replies_wanted = 0
            self.devices[index].asked = -1
            self.devices[index].owed, self.devices[index].missed = False, 0
            self.devices[index].answered = self.devices[index].doubtful = False
            memset(self.devices[index].malformed, 0, sizeof(self.devices[index].malformed))
            if self.devices[index].bands != NULL:
                (<SpeedBands>self.devices[index].bands).forget()
            if self.devices[index].latency != NULL:
                memset(self.devices[index].latency, 0, sizeof(Histogram))
        self.failed.device = self.failed.bus = -1
        self.drives.reset()
        self.warnings.reset()

    @property
    def culprit(self) -> str | None:
        """Path of the device or bus that failed last, or None."""
        if self.failed.device >= 0:
            return self.schedule.devices[self.failed.device].name
        return self.schedule.buses[self.failed.bus] if self.failed.bus >= 0 else None

    def silent(self) -> list[str]:
        """Return the paths of the devices with too few replies, or not ready."""
        return [self.schedule.devices[index].name for index in range(self.count)
            if not self.has_answered(&self.devices[index])]

    @property
    def unready(self) -> list[str]:
        """Return the paths of the devices that reply but have not returned what arming wrote."""
        return [
            self.schedule.devices[index].name for index in range(self.count)
            if self.devices[index].ready >= 0 and self.devices[index].answered
            and self.arena[self.devices[index].ready] == 0.0]

    @property
    def latencies(self) -> dict[str, dict[str, float]]:
        """Return {path: cext.clock.histogram.summary of its reply times in s} of the timed devices."""
        return {
            self.schedule.devices[index].name: summary(self.devices[index].latency)
            for index in range(self.count) if self.devices[index].latency != NULL
        }

    @property
    def missed(self) -> dict[str, int]:
        """Return {path: commands without a reply before the next one, from tick `counted_from` on} of the commanded
        devices.
        """
        return {
            self.schedule.devices[index].name: self.devices[index].missed for index in range(self.count)
            if self.devices[index].zero.count}

    @property
    def malformed(self) -> dict[str, tuple[dict[int, int], int]]:
        """Return {path: ({length: frames}, first byte of the newest)} of the devices that rejected frames of their
        own id.
        """
        found = {}
        for index in range(self.count):
            lengths = {length: self.devices[index].malformed[length] for length in range(FRAME_BYTES + 1)
                if self.devices[index].malformed[length]}
            if lengths:
                found[self.schedule.devices[index].name] = lengths, self.devices[index].rejected_id
        return found

    @property
    def unzeroed(self) -> list[str]:
        """Return the paths of the devices whose zero arming has not set, although they reply."""
        return [self.schedule.devices[index].name for index in range(self.count)
            if self.devices[index].zeroing.due and self.has_replied(&self.devices[index])]

    @property
    def switched(self) -> dict[str, tuple[int, int]]:
        """Return {path: (times taken out, times armed again)} of the drives that were taken out during the run."""
        return {
            self.schedule.devices[index].name: (self.devices[index].drive.taken_out, self.devices[index].drive.returned)
            for index in range(self.count) if self.devices[index].drive.taken_out or self.devices[index].drive.returned}

    @property
    def zeros(self) -> dict[str, tuple[int, int]]:
        """Return {path: (number of zeros set, number of refused requests)} of the devices with any."""
        return {
            self.schedule.devices[index].name: (self.devices[index].zeroing.set, self.devices[index].zeroing.refused)
            for index in range(self.count) if self.devices[index].zeroing.set or self.devices[index].zeroing.refused}

    cdef int time_replies(self) except -1:
        """Time the reply of every device to each command from now on."""
        for index in range(self.count):
            if self.devices[index].latency == NULL and self.devices[index].zero.count:
                self.devices[index].latency = <Histogram *>calloc(1, sizeof(Histogram))
                if self.devices[index].latency == NULL:
                    raise MemoryError
        return 0

    cdef int load(self) except -1:
        cdef Device *device
        cdef int index
        devices = self.schedule.devices
        self.count = len(devices)
        self.devices = <Device *>calloc(max(1, len(devices)), sizeof(Device))
        # of each device its command, and the frame that sets its zero
        self.outgoing = <Frame *>calloc(max(1, len(devices)) * (FRAMES_PER_DEVICE + 1), sizeof(Frame))
        self.templates = <void **>calloc(max(1, len(devices)) * DEVICE_EVENTS, sizeof(void *))
        self.news = []
        self.outgoing_count = <int32_t *>calloc(max(1, self.bus_count), sizeof(int32_t))
        for index, entry in enumerate(devices):              # the schedule lists them bus by bus
            device = &self.devices[index]
            device.decode = <decode_t><uintptr_t>address(entry.decode, "decode")
            device.encode = <encode_t><uintptr_t>address(entry.encode, "encode")
            self.keep += [entry.decode, entry.encode]
            tables = [words(table) for pair in (entry.decode_table, entry.encode_table) for table in (pair.slots,
                pair.sizes)]
            self.keep += tables
            device.decode_slots = <int32_t *><uintptr_t>tables[0].ctypes.data
            device.decode_sizes = <int32_t *><uintptr_t>tables[1].ctypes.data
            device.encode_slots = <int32_t *><uintptr_t>tables[2].ctypes.data
            device.encode_sizes = <int32_t *><uintptr_t>tables[3].ctypes.data
            device.bus, device.age, device.fault, device.timeout = entry.bus, entry.age, entry.fault, entry.timeout
            device.ready, device.ready_size = entry.ready, entry.ready_size
            if entry.ready_size > READY_NUMBERS:
                raise ValueError(
                    f"{entry.name}: at most {READY_NUMBERS} values outlive the start, not {entry.ready_size}")
            load_batch(&device.enable, entry.enable)
            for place, frame in enumerate(entry.enable):
                device.only_reads[place] = frame in entry.reads
            load_batch(&device.zero, entry.zero)
            load_batch(&device.disable, entry.disable)
            self.load_zeroing(index, entry)
            device.bands = NULL
            if entry.damp is not None:
                bands = SpeedBands(entry.damp.bands, round(entry.damp.round * 1e9), entry.damp.acceleration,
                    entry.damp.velocity)
                self.keep.append(bands)
                device.bands = <void *>bands
                device.damping = round(entry.damp.duration * 1e9)
                self.longest_damping = max(self.longest_damping, device.damping)
            device.unanswered = entry.unanswered
            device.relay = round(entry.relay_time * 1e9)
            self.start_time = max(self.start_time, round(entry.start_time * 1e9))
        return 0

    def load_zeroing(self, int index, entry):
        """Set how the zero of a device is set. entry : graph.schedule.DeviceSteps"""
        cdef Zeroing *z = &self.devices[index].zeroing
        steps = entry.zeroing
        z.position = z.request = z.law = z.current = -1
        z.at_arming = False
        self.devices[index].drive.disabled = entry.disabled_slot
        self.devices[index].drive.disable = entry.disable_slot
        self.devices[index].drive.active = entry.active_slot
        if steps is not None or entry.disabled_slot >= 0:
            for event, (kind, what) in EVENTS.items():
                words = {"event": kind, "device": entry.name, "what": what.format(path=entry.name)}
                if kind == "drive":
                    words["lines"] = [f"tickwork: {entry.name} is {words['what']}"]
                template = EventTemplate(words)
                self.news.append(template)
                self.templates[index * DEVICE_EVENTS + event] = <void *>template
        if steps is None:
            return
        zeroing = steps.zeroing
        load_batch(&self.devices[index].set_zero, [zeroing.frame])
        z.position, z.request, z.law, z.current = steps.position, steps.request, steps.law, steps.current
        z.offset, z.torque_code, z.at_arming = zeroing.offset, zeroing.torque_code, zeroing.at_arming

    cdef uint64_t share(self, SharedLayout *page):
        """Set the shared state for events, or NULL. Returns the ring bytes that one tick may need."""
        self.page = page
        return sum(8 + (<EventTemplate>template).size() for template in self.news)

    cdef void note(self, int number, int event) noexcept nogil:
        """Publish an event of a device."""
        if self.templates[number * DEVICE_EVENTS + event] != NULL:
            (<EventTemplate>self.templates[number * DEVICE_EVENTS + event]).publish(
                self.page, <int64_t>self.arena[TICK])

    cdef void begin(self, int64_t began) noexcept nogil:
        """Set the zero of the frames' times of all buses, in ns of CLOCK_MONOTONIC."""
        cdef int bus
        self.began = began
        for bus in range(self.bus_count):
            if (<BusEnd>self.bus_ends[bus]).bus.begin != NULL:
                (<BusEnd>self.bus_ends[bus]).bus.begin((<BusEnd>self.bus_ends[bus]).bus.context, began)

    cdef int receive(self, int64_t now, SharedLayout *page) noexcept nogil:
        """Drain every bus, CAN of at most FRAMES_PER_TICK, and offer each frame to its devices. `page` may be NULL.

        All other buses are drained even if one fails.
        """
        cdef int bus, count, number, rounds
        cdef int status = OK
        cdef int offered
        cdef Device *device
        self.now = now
        if page != NULL and self.bus_count > 0:
            log_received(page, now)
        for bus in range(self.bus_count):
            if (<BusEnd>self.bus_ends[bus]).bus.at != NULL:
                (<BusEnd>self.bus_ends[bus]).bus.at((<BusEnd>self.bus_ends[bus]).bus.context, now)
            for rounds in range(self.rounds[bus]):
                count = (<BusEnd>self.bus_ends[bus]).bus.receive(
                    (<BusEnd>self.bus_ends[bus]).bus.context, self.received, FRAMES_PER_TICK)
                if count < 0:
                    self.failed.bus = bus
                    status = BUS_ERROR
                offered = self.offer(bus, count, page)
                if offered != OK:
                    status = offered
                if count < FRAMES_PER_TICK:
                    break
        for number in range(self.count):
            device = &self.devices[number]
            if device.age >= 0:
                # the sample may be newer than the tick
                self.arena[device.age] = max(now - device.reply_time, 0) * 1e-9
            if device.drive.active >= 0:
                self.arena[device.drive.active] = device.drive.state == ACTIVE
            if device.zeroing.position >= 0:
                note_position(&device.zeroing, self.arena, device.reply_time, now)
        return status

    cdef int offer(self, int bus, int count, SharedLayout *page) noexcept nogil:
        """Offer received frames of a bus to its devices. Returns OK, or the status with which a frame ends the run."""
        cdef int index, number
        cdef int status = OK
        cdef Frame *frame
        cdef Device *device
        cdef double share = self.arena[AUTHORITY]
        cdef int answer = FOREIGN
        for index in range(count):
            frame = &self.received[index]
            frame.bus = <uint8_t>bus
            frame.sent = 0
            answer = FOREIGN
            for number in range(self.count):
                device = &self.devices[number]
                if device.bus != bus:
                    continue
                if device.drive.state != ACTIVE:                 # a report of a disabled drive is expected
                    self.arena[AUTHORITY] = 0.0
                answer = device.decode(self.arena, device.decode_slots, device.decode_sizes, frame)
                self.arena[AUTHORITY] = share
                # in every state, including arming and the wait for confirmation
                if answer == PRESSED:
                    self.failed.device = number
                    status = ESTOP
                    answer = TAKEN
                if answer == ANSWERED:
                    device.owed, device.asked = False, -1
                if answer == TAKEN or answer == MOVING:
                    if device.doubtful and self.alone:         # a reply under its own id: the other frame was a command
                        self.failed.device = number
                        status = FOREIGN_COMMAND
                    device.owed = device.doubtful = False
                    device.answered = True
                    device.reply_time = frame.time
                    device.replies += answer == TAKEN or not self.stopping
                    if device.asked >= 0:
                        add(device.latency, frame.time - device.asked, <int64_t>self.arena[TICK])
                        device.asked = -1
                if answer == MALFORMED:
                    device.malformed[frame.length if frame.length < FRAME_BYTES else FRAME_BYTES] += 1
                    device.rejected_id = frame.data[0] if frame.length > 0 else -1
                if answer != FOREIGN:
                    if device.bands != NULL and answer != MALFORMED:
                        (<SpeedBands>device.bands).note(frame)
                    break
            if self.alone and (answer == FOREIGN or answer == COMMANDED or answer == MALFORMED):
                if answer != COMMANDED:                        # otherwise the device has detected the command itself
                    number = self.commanded(frame)
                if number >= 0 and answer == MALFORMED and self.may_be_reply(&self.devices[number], frame):
                    self.devices[number].doubtful = True
                # then the guardian commands
                elif number >= 0 and not (page != NULL and load_i32(&page.fence) == FENCED_FOR_GOOD):
                    self.failed.device = number
                    status = FOREIGN_COMMAND
            if page != NULL:
                page.frames_received += 1
                page.frames_foreign += answer == FOREIGN or answer == COMMANDED
                page.frames_malformed += answer == MALFORMED
                log_frame(page, frame)
        return status

    cdef int commanded(self, const Frame *frame) noexcept nogil:
        """Return the device that a frame other than a reply commands, by id and length of its own commands; -1 for
        none.
        """
        cdef int number
        for number in range(self.count):
            if self.devices[number].bus == frame.bus and (
                    is_like(&self.devices[number].zero, frame, NULL) or is_like(&self.devices[number].disable, frame,
                        NULL)
                    or is_like(&self.devices[number].enable, frame, self.devices[number].only_reads)):
                return number
        return -1

    cdef bint may_be_reply(self, Device *device, const Frame *frame) noexcept nogil:
        """Return whether a frame with the id and length of own commands may be the drive's reply with another id or
        length.

        Principle: 1. replies and commands of MIT mode share id and length and differ in the first byte only; 2. a drive
        replies to every command, also of another controller, so that replies with its own id arrive, too, if another
        controller commands it: the next of them shows that this frame was a command; 3. until then, a frame may be a
        reply if one is due; if none is due, or if the frame equals one of the own commands, it is a command.
        """
        return (device.owed or not device.answered) and not (
            is_same(&device.zero, frame) or is_same(&device.disable, frame) or is_same(&device.enable, frame))

    cdef int watch(self, int64_t now) noexcept nogil:
        """Check every device for silence, faults and temperature. Returns OK or the fault."""
        cdef int number, status
        cdef Device *device
        for number in range(self.count):
            device = &self.devices[number]
            if device.drive.state != ACTIVE:
                continue
            if (device.timeout > 0.0 and (now - device.reply_time) * 1e-9 > device.timeout
                    and not device.zeroing.runs):                # a drive may be silent for a second after that frame
                self.failed.device = number
                return SILENT
            if device.fault >= 0 and self.arena[device.fault] != 0.0:
                self.failed.device = number
                return DEVICE_FAULT
        self.warnings.look(self.arena, <int64_t>self.arena[TICK])
        for number in range(self.drives.count):
            device = &self.devices[self.drives.drives[number].device]
            self.drives.drives[number].reply_time = device.reply_time
            self.drives.drives[number].off = device.zeroing.runs
            self.drives.drives[number].out = device.drive.state != ACTIVE
        status = self.drives.look(self.arena, <int64_t>self.arena[TICK], self.arena[DT])
        if status != OK:
            self.failed.device = self.drives.failed
        return status

    cdef int command(self) noexcept nogil:
        """Encode the frames of each device into `outgoing`, bus by bus.

        Returns OK, or the status of a device that cannot encode.
        """
        cdef int number, count
        cdef int total = 0
        cdef Device *device
        memset(self.outgoing_count, 0, self.bus_count * sizeof(int32_t))
        for number in range(self.count):
            device = &self.devices[number]
            if device.drive.disabled >= 0:
                self.look_at_state(number)
            count = self.look_at_zero(number)
            if count >= 0:
                count = self.encode(device, &self.outgoing[total])
            if device.drive.state != ACTIVE:
                count = 0                                        # neither commanded nor checked
            if count < 0:
                self.failed.device = number
                return -count
            count = self.add_zero(number, &self.outgoing[total], count)
            total += count
            self.outgoing_count[device.bus] += count
            if self.laps != NULL and self.laps.each != NULL:
                lap(self.laps, self.item + number)
        if self.laps != NULL and self.laps.each == NULL and self.count > 0:
            lap(self.laps, COMMAND)
        return OK

    cdef int encode(self, Device *device, Frame *frames) noexcept nogil:
        """Encode the frames of a device, with zero torque while its zero is set and while it is taken out.

        Returns their number, or a negated status.
        """
        cdef double share = self.arena[AUTHORITY]
        cdef double faded = 1.0
        cdef int count
        if device.fades_from >= 0:
            if self.fade > 0.0:
                faded = (self.arena[TICK] - device.fades_from) * self.arena[PERIOD] / self.fade
            if faded >= 1.0:
                device.fades_from = -1
            else:
                self.arena[AUTHORITY] = share * max(faded, 0.0)
        if device.zeroing.runs or device.drive.state != ACTIVE:
            self.arena[AUTHORITY] = 0.0
        count = device.encode(self.arena, device.encode_slots, device.encode_sizes, frames)
        self.arena[AUTHORITY] = share
        if device.zeroing.position >= 0:
            note_command(&device.zeroing, self.arena, self.now)
        return count

    cdef int look_at_zero(self, int number) noexcept nogil:
        """End the zeroing of a device, if it runs and a reply or the time decides it.

        Returns OK or a negated status.
        """
        cdef Device *device = &self.devices[number]
        cdef Zeroing *z = &device.zeroing
        cdef int result, place
        if not z.runs:
            return OK
        result = judge_zero(z, self.arena, self.now)
        if result == ZERO_UNKNOWN:
            for place in range(self.drives.count):
                if self.drives.drives[place].device == number:
                    blame(&self.drives.drives[place].motion, IMPLAUSIBLE, POSITION, self.arena[z.position], -z.offset)
            return -IMPLAUSIBLE
        if result == ZERO_SET or result == ZERO_KEPT:
            z.runs = False
            device.fades_from = <int64_t>self.arena[TICK]
            z.set += result == ZERO_SET
            z.refused += result == ZERO_KEPT
            self.note(number, ZEROED if result == ZERO_SET else ZERO_NOT_SET)
        return OK

    cdef int add_zero(self, int number, Frame *frames, int count) noexcept nogil:
        """Add the frame that sets the zero of a device, if it is requested and permitted, or was lost.

        count : number of frames of the device. Returns the new number
        """
        cdef Device *device = &self.devices[number]
        cdef Zeroing *z = &device.zeroing
        cdef bint requested = z.request >= 0 and self.arena[z.request] > 0.5
        cdef bint rises = requested and not z.requested
        cdef bint permitted
        if z.position < 0:
            return count
        z.requested = requested
        permitted = not self.waiting and device.drive.state == ACTIVE and may_be_zeroed(z, self.now)
        if z.runs and permitted and judge_zero(z, self.arena, self.now) == ZERO_LOST:
            repeat_zero(z, self.now)
        elif not z.runs and rises and permitted:
            begin_zero(z, self.arena, self.now)
        else:
            if rises:
                z.refused += 1
                self.note(number, ZERO_REFUSED)
            return count
        frames[count] = device.set_zero.frames[0]
        return count + 1

    cdef int transmit(self, int64_t now, SharedLayout *page) noexcept nogil:
        cdef int bus, status
        cdef int first = 0
        for bus in range(self.bus_count):
            status = self.send(bus, &self.outgoing[first], self.outgoing_count[bus], now, page, False)
            if status != OK:
                return status
            first += self.outgoing_count[bus]
            self.note_asked(bus, now)
        return self.send_state(now, page)

    cdef void look_at_state(self, int number) noexcept nogil:
        """Take a drive out, or let it return, as its parameter and its input require."""
        cdef Device *device = &self.devices[number]
        cdef bint disabled
        cdef int64_t passed = self.now - device.drive.since
        if not self.arena[device.drive.disable] <= 0.5 and not self.arena[device.drive.disabled] > 0.5:
            self.live.assume(device.drive.disabled, 1.0)
            self.live.show(self.page)
        disabled = self.arena[device.drive.disabled] > 0.5
        device.drive.silent |= self.now - device.reply_time > POWER_LOSS
        if self.waiting:
            device.drive.silent |= disabled and device.drive.state == ACTIVE
            device.drive.state = OUT if disabled else ACTIVE     # all are disabled, and armed together
        elif device.drive.state == ACTIVE and disabled:
            self.take_out(number)
        elif device.drive.state == DAMPED and passed >= device.damping:
            enter(&device.drive, OUT, self.now)
        elif device.drive.state == OUT and not disabled:
            enter(&device.drive, RETURNING, self.now)
            if device.ready >= 0:
                self.arena[device.ready] = 0.0
            device.replies = device.rounds = 0
            device.replies_wanted = device.zero.count
            begin_rest(&device.zeroing, self.now)
        elif device.drive.state == RETURNING and disabled:
            enter(&device.drive, OUT, self.now)
        elif device.drive.state == RETURNING and passed < RETURN_DELAY:
            device.replies = 0                                   # to the disable
        elif device.drive.state == RETURNING and self.has_answered(device) and self.is_fit(number):
            enter(&device.drive, ACTIVE, self.now)
            device.fades_from = <int64_t>self.arena[TICK]
            device.drive.returned += 1
            self.note(number, RETURNED)
        elif device.drive.state == RETURNING and passed >= ARMING_LIMIT + (
                ZERO_LIMIT if device.zeroing.due and self.has_replied(device) else 0):
            self.disable_again(number, NOT_RETURNED)

    cdef void take_out(self, int number) noexcept nogil:
        cdef Device *device = &self.devices[number]
        enter(&device.drive, OUT if device.bands == NULL else DAMPED, self.now)
        device.damp_due = device.drive.sent = 0
        device.drive.silent = False
        device.zeroing.runs = False
        device.drive.taken_out += 1
        self.note(number, TAKEN_OUT)

    cdef void disable_again(self, int number, int event) noexcept nogil:
        """Take out a drive that cannot be armed again."""
        cdef Device *device = &self.devices[number]
        self.live.assume(device.drive.disabled, 1.0)
        self.live.show(self.page)
        enter(&device.drive, OUT, self.now)
        device.zeroing.runs = False
        self.note(number, event)

    cdef bint is_fit(self, int number) noexcept nogil:
        """Return whether a drive that has replied may be commanded without an immediate fault."""
        cdef Device *device = &self.devices[number]
        cdef Watched *watched
        cdef int place
        cdef double position
        if (self.now - device.reply_time) * 1e-9 > 0.5 * device.timeout and device.timeout > 0.0:
            return False
        if device.fault >= 0 and self.arena[device.fault] != 0.0:
            return False
        for place in range(self.drives.count):
            watched = &self.drives.drives[place]
            if watched.device != number:
                continue
            if watched.temperature >= 0 and self.arena[watched.temperature] >= watched.hot:
                return False
            if watched.motion.position < 0:
                continue
            position = self.arena[watched.motion.position]
            if not isfinite(position) or not (watched.motion.low - 1e-3 * TRAVEL_MARGIN <= position
                    <= watched.motion.high + 1e-3 * TRAVEL_MARGIN):
                return False
            if watched.motion.velocity >= 0 and not (
                    fabs(self.arena[watched.motion.velocity]) <= watched.motion.fastest):
                return False
        if self.may_return is None or not device.drive.silent:
            return True
        with gil:
            try:
                return bool(self.may_return(self.schedule.devices[number].name))
            except Exception:
                return False

    cdef int send_state(self, int64_t now, SharedLayout *page) noexcept nogil:
        """Send the frames of the drives that are taken out or return.

        A drive in OUT that does not reply gets its frames twice a second, so that they do not fill the queue of a bus
        without another node.
        """
        cdef int number
        cdef int status = OK
        cdef int64_t period = <int64_t>(1e9 * self.arena[PERIOD])
        cdef Device *device
        cdef Batch *batch
        for number in range(self.count):
            device = &self.devices[number]
            if device.drive.state == DAMPED:                     # in force until the next tick, which may be late
                batch = <Batch *>(<SpeedBands>device.bands).choose(now + 2 * period)
                status |= self.send(device.bus, batch.frames, batch.count, now, page, False)
            elif device.drive.state == OUT and (
                    now - device.drive.since < STOP_LIMIT or now - device.reply_time < STOP_LIMIT
                    or now - device.drive.sent >= SILENT_ROUND):
                device.drive.sent = now
                if now - device.drive.since < STOP_LIMIT:
                    status |= self.send(device.bus, device.zero.frames, device.zero.count, now, page, False)
                status |= self.send(device.bus, device.disable.frames, device.disable.count, now, page, False)
            elif device.drive.state == RETURNING and now - device.drive.since >= RETURN_DELAY:
                if not self.has_replied(device) and device.enable.count > 0:
                    if device.rounds % device.enable.count == 0:
                        status |= self.send(device.bus, device.enable.frames, device.enable.count, now, page, False)
                    device.rounds += 1
                status |= self.send(device.bus, device.zero.frames, device.zero.count, now, page, False)
                if self.zero_while_arming(number):
                    status |= self.send(device.bus, device.set_zero.frames, device.set_zero.count, now, page, False)
        return self.sent(status, False, page)

    cdef void note_asked(self, int bus, int64_t at) noexcept nogil:
        """Start timing the replies of a bus's devices, unless the previous reply is still due."""
        cdef int number
        cdef int64_t now = -1
        for number in range(self.count):
            if self.devices[number].bus == bus:
                self.devices[number].pumped = at
            if self.devices[number].bus == bus and self.devices[number].zero.count:
                if (self.devices[number].owed and self.devices[number].drive.state == ACTIVE
                        and self.arena[TICK] >= self.counted_from):
                    self.devices[number].missed += 1
                self.devices[number].owed = True
            if (self.devices[number].bus == bus and self.devices[number].latency != NULL
                    and self.devices[number].drive.state == ACTIVE):
                if now < 0:
                    now = monotonic() - self.began
                self.devices[number].asked = now

    cdef int send(self, int bus, Frame *frames, int count, int64_t now, SharedLayout *page, bint stopping) noexcept nogil:
        """Send frames; behind the fence only those of the safe stop. stopping : whether they belong to it"""
        cdef int index
        if count == 0:
            return OK
        for index in range(count):
            frames[index].time = now
            frames[index].bus = <uint8_t>bus
            frames[index].sent = 1
        if not stopping and page != NULL and load_i32(&page.fence):     # last: the process may be suspended before
            return FENCED
        count = (<BusEnd>self.bus_ends[bus]).bus.send((<BusEnd>self.bus_ends[bus]).bus.context, frames, count)
        if count < 0:
            self.failed.bus = bus
            return BUS_ERROR
        if page != NULL:                        # a full queue accepts fewer; only the accepted ones were sent
            page.frames_sent += count
            for index in range(count):
                log_frame(page, &frames[index])
        return OK

    cdef int send_batches(self, bint enable, bint zero, bint disable, int64_t now, SharedLayout *page) noexcept nogil:
        """Send frames that were encoded at compile time to every device; `enable` only to those that have not replied.

        Behind the fence only the frames of the safe stop are sent: those with `disable`.
        """
        cdef int number
        cdef Device *device
        cdef int status = OK
        for number in range(self.count):
            device = &self.devices[number]
            if not disable and device.drive.state != ACTIVE:
                status |= self.send(device.bus, device.disable.frames, device.disable.count, now, page, False)
                continue
            if enable and not self.has_replied(device) and device.enable.count > 0:
                if device.rounds % device.enable.count == 0:       # less often for many frames, to limit the bus load
                    status |= self.send(device.bus, device.enable.frames, device.enable.count, now, page, disable)
                device.rounds += 1
            if zero:
                status |= self.send(device.bus, device.zero.frames, device.zero.count, now, page, disable)
            if enable and self.zero_while_arming(number):
                status |= self.send(device.bus, device.set_zero.frames, device.set_zero.count, now, page, False)
            if not disable and device.relay > 0:
                status |= self.pump(device, now, page, False)
            if disable:
                status |= self.send(device.bus, device.disable.frames, device.disable.count, now, page, True)
        return self.sent(status, disable, page)

    cdef bint zero_while_arming(self, int number) noexcept nogil:
        """Return whether the frame that sets the zero of a device is to be sent now: it was enabled, and is at rest."""
        cdef Device *device = &self.devices[number]
        cdef Zeroing *z = &device.zeroing
        cdef int result = ZERO_LOST
        if not z.due or not self.has_replied(device):
            return False
        if z.runs:
            result = judge_zero(z, self.arena, self.now)
        if result == ZERO_SET:
            z.runs = z.due = False
            device.drive.silent = False                          # its angle is certain
            z.set += 1
            self.note(number, ZEROED)
        elif result == ZERO_KEPT or result == ZERO_UNKNOWN:
            z.runs = False
        if result != ZERO_LOST or not may_be_zeroed(z, self.now):
            return False
        if z.runs:
            repeat_zero(z, self.now)
        else:
            begin_zero(z, self.arena, self.now)
        return True

    cdef int sent(self, int status, bint stopping, SharedLayout *page) noexcept nogil:
        """Return OK, FENCED or BUS_ERROR from the combined bits of several statuses of `send`."""
        if status == OK:
            return OK
        return FENCED if not stopping and page != NULL and load_i32(&page.fence) else BUS_ERROR

    cdef int pump(self, Device *device, int64_t now, SharedLayout *page, bint stopping) noexcept nogil:
        """Send the next frame of a device that holds a relay, outside a tick."""
        cdef Frame[FRAMES_PER_DEVICE] frames
        cdef int count = device.encode(self.arena, device.encode_slots, device.encode_sizes, frames)
        device.pumped = now
        return self.send(device.bus, frames, max(count, 0), now, page, stopping)

    cdef bint holds_relay(self, const Device *device, int64_t now) noexcept nogil:
        """Return whether a relay has not dropped since its last frame.

        now : ns since the begin of the run. On a rig the clock is read again, as the process may have been suspended.
        """
        return (monotonic() - self.began if self.alone else now) - device.pumped < device.relay

    cdef int pump_all(self, int64_t now, SharedLayout *page) noexcept nogil:
        """Send frames to the devices that hold relays, while the drives behind the relays start."""
        cdef int number
        cdef int status = OK
        for number in range(self.count):
            if self.devices[number].relay > 0:
                status |= self.pump(&self.devices[number], now, page, False)
        return self.sent(status, False, page)

    cdef void begin_stop(self) noexcept nogil:
        """Begin a safe stop. Damping depends on the first `since` of `send_stop`."""
        cdef int number
        self.stop_due = 0
        for number in range(self.count):
            self.devices[number].zeroing.runs = False
            self.devices[number].damped = self.devices[number].bands != NULL and self.devices[number].drive.state < OUT
            self.devices[number].damp_due = 0

    cdef int64_t send_stop(self, int64_t since, int64_t now, int64_t round, SharedLayout *page) noexcept nogil:
        """Send the due frames of the safe stop `since` ns after its begin: damping by the newest speeds, zero torque
        and disable every `round` ns.

        A device is damped until the first round after its time. Returns when the next frames are due, in ns since the
        begin of the stop.

        A relay is held while any device is damped, unless it may have dropped: a safe stop never restores a drive's
        power.
        """
        cdef int number
        cdef Device *device
        cdef Batch *batch
        cdef bint disabling = since >= self.stop_due
        cdef int64_t due
        if disabling:
            self.stop_due = next_due(self.stop_due, since, round)
        due = self.stop_due
        for number in range(self.count):
            device = &self.devices[number]
            if device.relay > 0:
                if disabling and since < self.longest_damping and self.holds_relay(device, now):
                    self.pump(device, now, page, True)
            elif device.damped and (since < device.damping or not disabling):
                if since >= device.damp_due:
                    batch = <Batch *>(<SpeedBands>device.bands).choose(now)
                    self.send(device.bus, batch.frames, batch.count, now, page, True)
                    device.damp_due = next_due(device.damp_due, since, (<SpeedBands>device.bands).round)
                due = min(due, device.damp_due)
            elif disabling:
                device.damped = False
                self.send(device.bus, device.zero.frames, device.zero.count, now, page, True)
                self.send(device.bus, device.disable.frames, device.disable.count, now, page, True)
        return due

    cdef void note_speeds(self, SharedLayout *page) noexcept nogil:
        """Read frames for the speeds of damped devices. The arena stays as the hung tick has left it."""
        cdef int bus, index, number, count
        for bus in range(self.bus_count):
            for number in range(self.count):
                if self.devices[number].bus == bus and self.devices[number].damped:
                    break
            else:
                continue
            count = (<BusEnd>self.bus_ends[bus]).bus.receive((<BusEnd>self.bus_ends[bus]).bus.context, self.received,
                FRAMES_PER_TICK)
            for index in range(count):
                self.received[index].bus = <uint8_t>bus
                self.received[index].sent = 0
                for number in range(self.count):
                    if self.devices[number].bus == bus and self.devices[number].bands != NULL:
                        (<SpeedBands>self.devices[number].bands).note(&self.received[index])
                if page != NULL:
                    page.frames_received += 1
                    log_frame(page, &self.received[index])

    cdef bint has_replied(self, const Device *device) noexcept nogil:
        """Return whether a device has replied, and returned what arming writes to it."""
        return device.replies >= device.replies_wanted and (self.stopping or device.ready < 0
            or self.arena[device.ready] != 0.0)

    cdef bint has_answered(self, const Device *device) noexcept nogil:
        if device.drive.state == OUT and not self.stopping:
            return True
        return self.has_replied(device) and (self.stopping or not device.zeroing.due)

    cdef bint only_zeros_are_due(self) noexcept nogil:
        """Return whether arming waits for nothing but the zeros of drives."""
        cdef int number
        for number in range(self.count):
            if self.devices[number].drive.state == ACTIVE and not self.has_replied(&self.devices[number]):
                return False
        return True

    cdef bint all_answered(self) noexcept nogil:
        cdef int number
        for number in range(self.count):
            if not self.has_answered(&self.devices[number]):
                return False
        return True

    cdef void begin_arming(self) noexcept nogil:
        """Require every device to reply and to return what is written to it, even if it has before, as its power may
        have been off.
        """
        cdef int number
        self.waiting = False
        for number in range(self.count):
            if self.devices[number].ready >= 0:
                self.arena[self.devices[number].ready] = 0.0
            self.devices[number].fades_from = -1
            if self.devices[number].drive.disabled >= 0:
                self.devices[number].drive.state = (
                    OUT if self.arena[self.devices[number].drive.disabled] > 0.5 else ACTIVE)
            begin_rest(&self.devices[number].zeroing, self.now)
        self.want_replies(True, False)

    cdef void keep_ready(self) noexcept nogil:
        """Save the values that arming has read back, before the blocks reset."""
        cdef int number
        for number in range(self.count):
            if self.devices[number].ready >= 0:
                memcpy(self.devices[number].ready_kept, self.arena + self.devices[number].ready,
                    self.devices[number].ready_size * sizeof(double))

    cdef void restore_ready(self) noexcept nogil:
        cdef int number
        for number in range(self.count):
            if self.devices[number].ready >= 0:
                memcpy(self.arena + self.devices[number].ready, self.devices[number].ready_kept,
                    self.devices[number].ready_size * sizeof(double))

    cdef void want_replies(self, bint zero, bint disable) noexcept nogil:
        cdef int number
        cdef Device *device
        self.stopping = disable
        for number in range(self.count):
            device = &self.devices[number]
            device.replies = device.rounds = 0
            device.replies_wanted = 0
            if zero:
                device.replies_wanted += device.zero.count
            if zero and not disable and device.zero.count == 0 and device.timeout > 0.0:
                # a sensor that sends by itself, and is checked for silence
                device.replies_wanted = 1
            if disable:
                device.replies_wanted += device.disable.count - device.unanswered

    cdef void discard(self) noexcept nogil:
        cdef int bus, rounds
        for bus in range(self.bus_count):
            for rounds in range(64):
                if (<BusEnd>self.bus_ends[bus]).bus.receive((<BusEnd>self.bus_ends[bus]).bus.context, self.received,
                        FRAMES_PER_TICK) <= 0:
                    break


cdef inline int64_t next_due(int64_t due, int64_t now, int64_t round) noexcept nogil:
    """Return the round after the one sent now: on the same grid, unless that one is missed as well."""
    return due + round if due + round > now else now + round


cdef inline bint is_like(const Batch *batch, const Frame *frame, const bint *left_out) noexcept nogil:
    cdef int index
    for index in range(batch.count):
        if left_out != NULL and left_out[index]:
            continue
        if batch.frames[index].id == frame.id and batch.frames[index].length == frame.length:
            return True
    return False


cdef inline bint is_same(const Batch *batch, const Frame *frame) noexcept nogil:
    cdef int index
    for index in range(batch.count):
        if (batch.frames[index].id == frame.id and batch.frames[index].length == frame.length
                and memcmp(batch.frames[index].data, frame.data, frame.length) == 0):
            return True
    return False


cdef inline void log_received(SharedLayout *page, int64_t now) noexcept nogil:
    cdef int64_t *room = <int64_t *>reserve(page, RECEIVED, sizeof(int64_t))
    if room == NULL:
        page.dropped += 1
        return
    room[0] = now
    commit(page)


cdef inline void log_frame(SharedLayout *page, const Frame *frame) noexcept nogil:
    cdef void *room = reserve(page, FRAME, sizeof(Frame))
    if room == NULL:
        page.dropped += 1
        return
    memcpy(room, frame, sizeof(Frame))
    commit(page)
