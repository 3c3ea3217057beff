# cython: freethreading_compatible=True
"""Devices of a schedule and their buses: the part of a tick that communicates.

    receive    drain every bus, and offer each frame to its devices
    watch      check for silent devices and faults
    command    encode the frames of each device; nothing is sent if one fails
    transmit   send the frames

Its parts, of the modules of these names: `arming`, `stop` for the safe stop, `switch` for drives that are taken out.
"""

from libc.stdlib cimport calloc, free
from libc.string cimport memset

from cext.abi cimport (
    ANSWERED, AUTHORITY, COMMANDED, DT, ERROR_FRAME, ESTOP, FOREIGN, FRAME_BYTES, FRAMES_PER_BATCH,
    FRAMES_PER_DEVICE, FRAMES_PER_TICK, IDLE, MALFORMED, OK, PERIOD, PRESSED, TAKEN, TICK, TWIN,
)
from cext.atomics cimport store_i64
from cext.status cimport BUS_ERROR, DEVICE_FAULT, FOREIGN_COMMAND, HUNG, SILENT, TWO_DEVICES
from cext.clock.deadline_clock cimport monotonic
from cext.clock.histogram cimport add
from cext.clock.stopwatch cimport COMMAND, lap
from cext.safety.drive_state cimport ACTIVE, OUT
from cext.safety.drive_watch cimport Watched
from cext.safety.motion_watch cimport is_stiff
from cext.memory.shared_state cimport FENCED_FOR_GOOD, load_i32
from cext.safety.speed_bands cimport SpeedBands
from cext.safety.stop_confirmation cimport StopConfirmation
from cext.safety.thresholds cimport FADE_IN, RESTART_PERIODS, STOP_LIMIT
from cext.safety.transit cimport (
    is_doubtful, longest_transit, note_arrival, note_asked, turn_memory, watch_transit,
)
from cext.safety.twins cimport expect_reports, forget_twins, note_answer, note_questions
from cext.safety.zeroing cimport note_command, note_position
from cext.schedule.arming_round cimport counts
from cext.schedule.drive_zeroing cimport add_zero, end_zeroing
from cext.schedule.foreign_commands cimport commanded_device, may_be_reply
from cext.kernels.devices.mit cimport all_ones
from cext.schedule.live cimport LiveTable

from cext.schedule.device_reports import DeviceReports

cdef enum:
    STALL_LIMIT = 50000000       # ns; emulated drives have time-outs of their own, of at least 0.1 s by default


cdef class Devices:
    """Devices of a `graph.Schedule`.

    Parameters
    ----------
    schedule : graph.Schedule
    ends : BusEnd, one for each of schedule.buses
    memory : the arena, an array of doubles that outlives this object
    live : LiveTable of the schedule, with the parameters that take drives out
    """

    def __init__(self, schedule, ends, memory, LiveTable live):
        self.buses = Buses(schedule, ends)
        self.table = DeviceTable(schedule, memory)
        self.drives = DriveWatch(schedule)
        self.warnings = DriveWarnings(schedule)
        self.events = DeviceEvents(schedule.devices)
        self.switch = DriveSwitch(self.table, self.buses, self.drives, self.events, live)
        self.arming = DeviceArming(self.table, self.buses, self.events, self.switch)
        self.stop = SafeStop(self.table, self.buses)
        self.reports = DeviceReports(self.table, self.buses, self.drives)
        self.fade = FADE_IN * 1e-9
        # the command of each device, and the frame that sets its zero
        self.outgoing = <Frame *>calloc(max(1, self.table.count) * (FRAMES_PER_DEVICE + 1), sizeof(Frame))
        self.outgoing_count = <int32_t *>calloc(max(1, self.buses.count), sizeof(int32_t))

    def __dealloc__(self):
        free(self.outgoing); free(self.outgoing_count)

    cdef void reset(self):
        """Restore the state before the first arming. Frames from before are discarded, as they are not replies."""
        if self.ran:
            self.buses.discard()
        self.ran = True
        self.table.reset()
        self.buses.failed = -1
        self.drives.reset()
        self.warnings.reset()

    cdef uint64_t share(self, SharedLayout *layout):
        """Set the shared state for frames and events, or NULL. Returns the ring bytes that the events of one tick may
        need.
        """
        self.buses.layout = layout
        return self.events.share(layout) + self.drives.share(layout) + self.warnings.share(layout)

    def longest_stall(self) -> int:
        """Return the ns for which the ticks of a simulation may stop before a device could time out."""
        cdef int number
        cdef Device *device
        cdef int64_t longest = STALL_LIMIT
        for number in range(self.table.count):
            device = &self.table.devices[number]
            for seconds in (device.timeout, device.restart_time, 1e-9 * device.relay):
                if seconds > 0.0:
                    longest = min(longest, <int64_t>(0.5e9 * seconds))
        return max(longest, 1)

    cdef Blame failed(self) noexcept nogil:
        """Return the device or bus that failed last."""
        cdef Blame failed
        failed.device, failed.bus = self.table.failed, self.buses.failed
        return failed

    cdef void blame(self, Blame failed) noexcept nogil:
        """Set the device or bus that failed last."""
        self.table.failed, self.buses.failed = failed.device, failed.bus

    cdef int receive(self, int64_t now) noexcept nogil:
        """Drain every bus, CAN of at most FRAMES_PER_TICK, and offer each frame to its devices.

        All other buses are drained even if one fails.
        """
        cdef int bus, count, number, reads
        cdef int status = OK
        cdef int offered
        cdef Device *device
        cdef double *arena = self.table.arena
        self.table.now = now
        for number in range(self.table.count):
            expect_reports(&self.table.devices[number].twins, now)      # before those that have waited
        self.buses.log_drain(now)
        for bus in range(self.buses.count):
            self.buses.set_time(bus, now)
            for reads in range(self.buses.reads[bus]):
                count = self.buses.receive(bus)
                if count < 0:
                    self.buses.failed = bus
                    status = BUS_ERROR
                offered = self.offer(bus, count)
                if offered != OK:
                    status = offered
                if count < FRAMES_PER_TICK:
                    break
        for number in range(self.table.count):
            device = &self.table.devices[number]
            if device.age >= 0:
                # the sample may be newer than the tick
                arena[device.age] = max(now - sampled_since(device), 0) * 1e-9
            if device.transit_slot >= 0:
                turn_memory(&device.transit, now)
                arena[device.transit_slot] = 1e-9 * longest_transit(&device.transit) + device.unseen
                arena[device.transit_slot + 1] = device.unseen
                arena[device.transit_slot + 2] = 1e-9 * (device.transit.likely - device.transit.reference)
            if device.drive.active >= 0:
                arena[device.drive.active] = device.drive.state == ACTIVE
            if device.zeroing.position >= 0:
                note_position(&device.zeroing, arena, device.reply_time, now)
        return status

    cdef int offer(self, int bus, int count) noexcept nogil:
        """Offer received frames of a bus to its devices. Returns OK, or the status with which a frame ends the run."""
        cdef int index, answer
        cdef int status = OK
        cdef Frame *frame
        cdef SharedLayout *layout = self.buses.layout
        for index in range(count):
            frame = &self.buses.received[index]
            answer = self.offer_one(bus, frame, &status)
            if layout != NULL:
                if not frame.id & ERROR_FRAME:              # which the controller makes, and the bus counts
                    layout.frames_received += 1
                    layout.frames_foreign += answer == FOREIGN or answer == COMMANDED
                    layout.frames_malformed += answer == MALFORMED
                self.buses.log_frame(frame)
        return status

    cdef int offer_one(self, int bus, Frame *frame, int *status) noexcept nogil:
        """Offer a frame to the devices of its bus until one takes it. Returns the answer of the last.

        status : set if the frame ends the run, in every state, including arming and the wait for confirmation
        """
        cdef int number
        cdef Device *device
        cdef double *arena = self.table.arena
        cdef double share = arena[AUTHORITY]
        cdef int answer = FOREIGN
        for number in range(self.table.count):
            device = &self.table.devices[number]
            if device.bus != bus:
                continue
            if device.drive.state != ACTIVE:                 # a report of a disabled drive is expected
                arena[AUTHORITY] = 0.0
            answer = device.decode(arena, device.decode_slots, device.decode_sizes, frame)
            arena[AUTHORITY] = share
            if answer == FOREIGN:
                continue
            if answer == PRESSED:
                self.table.failed = number
                status[0] = ESTOP
                answer = TAKEN
            if answer == ANSWERED:
                note_arrival(&device.transit, frame.time)
                device.owed = False
            elif answer == TAKEN or answer == IDLE:
                if device.doubtful and self.table.alone:     # a reply under its own id: the other frame was a command
                    self.table.failed = number
                    status[0] = FOREIGN_COMMAND
                device.was_enabled |= answer == TAKEN and self.table.arming and not device.enabling and (
                    device.reports_enabled)
                note_reply(device, frame, counts(device, answer), <int64_t>arena[TICK],
                    not self.table.arming and not self.table.stopping)
            elif answer == MALFORMED:
                device.malformed[frame.length if frame.length < FRAME_BYTES else FRAME_BYTES] += 1
                device.rejected_id = frame.data[0] if frame.length > 0 else -1
            if answer == TWIN or (device.twins.counted and answer != MALFORMED and self.is_twin(device, frame)):
                self.table.failed = number
                status[0] = TWO_DEVICES
            if device.bands != NULL and answer != MALFORMED:
                (<SpeedBands>device.bands).note(frame)
            if device.confirmation != NULL and (self.table.stopping or device.drive.state >= OUT):
                (<StopConfirmation>device.confirmation).note(frame)
            break
        if self.table.alone and (answer == FOREIGN or answer == COMMANDED or answer == MALFORMED):
            if answer != COMMANDED:                          # otherwise the device has detected the command itself
                number = commanded_device(self.table, frame)
            if number >= 0 and self.is_foreign_command(frame, answer, number):
                self.table.failed = number
                status[0] = FOREIGN_COMMAND
        return answer

    cdef bint is_foreign_command(self, const Frame *frame, int answer, int number) noexcept nogil:
        """Return whether a frame commands a device, and the guardian, which commands in its last stop, is not the sender.

        answer : result of the device's decode
        """
        cdef Device *device = &self.table.devices[number]
        if answer == MALFORMED and may_be_reply(device, frame):
            device.doubtful = True
            return False
        return not (self.buses.layout != NULL and load_i32(&self.buses.layout.fence) == FENCED_FOR_GOOD)

    cdef bint is_twin(self, Device *device, const Frame *frame) noexcept nogil:
        """Note a reply. Returns whether it shows that two devices have the id of a commanded one."""
        if self.table.stopping or self.table.waiting or device.drive.state != ACTIVE:
            forget_twins(&device.twins, self.table.now, FRAMES_PER_BATCH)
            return False
        return (<StopConfirmation>device.confirmation).is_reply(frame) and note_answer(
            &device.twins, frame.time)

    cdef bint is_unconfigured(self, const Device *device) noexcept nogil:
        """Return whether a sensor that has lost its settings may provide no samples before the next arming writes them.
        """
        return self.table.waiting and device.zero.count == 0 and device.set_up.count > 0

    cdef int watch(self, int64_t now) noexcept nogil:
        """Check every device for silence, faults and temperature. Returns OK or the fault."""
        cdef int number, status
        cdef Device *device
        cdef Watched *watched
        cdef double *arena = self.table.arena
        for number in range(self.table.count):
            device = &self.table.devices[number]
            if device.drive.state != ACTIVE:
                device.gap = 0
                continue
            if self.table.arming and not (device.answered and self.table.has_replied(device)):
                continue                                     # arming waits for it
            if (device.timeout > 0.0 and (now - device.reply_time) * 1e-9 > device.timeout
                    and not device.zeroing.runs                  # a drive may be silent for a second after that frame
                    and not self.is_unconfigured(device)):
                self.table.failed = number
                return SILENT
            if self.may_have_restarted(device, now):
                self.table.failed = number
                return SILENT
            device.gap = 0
            if device.fault >= 0 and arena[device.fault] != 0.0:
                self.table.failed = number
                return DEVICE_FAULT
        self.warnings.look(arena, <int64_t>arena[TICK])
        for number in range(self.drives.count):
            watched = &self.drives.drives[number]
            device = &self.table.devices[watched.device]
            watched.reply_time = device.reply_time if device.answered else -1
            watched.transit = device.unseen
            if device.transit.answers:
                watched.transit = 1e-9 * max(device.transit.newest, longest_transit(&device.transit))
            watched.late = not self.is_prompt(device)
            watched.off = device.zeroing.runs
            watched.out = device.drive.state != ACTIVE
            watched.stays_out = device.drive.state >= OUT and now - device.drive.since > STOP_LIMIT
            watched.replied = device.answered
            watched.motion.early = self.table.arming
            watched.motion.free = self.table.arming and not device.enabling
        status = self.drives.look(arena, <int64_t>arena[TICK], arena[DT])
        if status != OK:
            self.table.failed = self.drives.failed
        return status

    cdef bint is_prompt(self, const Device *device) noexcept nogil:
        """Return whether the measured transit of a drive permits stiffness and damping."""
        cdef double permitted = max(device.max_transit, self.table.arena[PERIOD]) + 1e-9
        return not device.transit.answers or (device.transit.measured and not is_doubtful(&device.transit)
            and 1e-9 * longest_transit(&device.transit) <= permitted)

    cdef bint may_have_restarted(self, const Device *device, int64_t now) noexcept nogil:
        """Return whether a drive was silent for long enough to have restarted, and would obey the next command.

        Also, while arming, whether its replies arrive in bursts between which it could restart.
        """
        cdef double period = device.report_period
        cdef double permitted, silent
        if device.restart_time <= 0.0 or device.zeroing.runs or self.table.waiting:
            return False
        if self.table.arming or device.transit.answers:
            period = max(period, self.table.arena[PERIOD])
        permitted = max(device.restart_time, RESTART_PERIODS * period)
        if self.table.arming:
            # a quarter of a period, so that a lost frame is none
            return device.enabling and 1e-9 * device.gap > permitted + 0.25 * period
        if not device.transit.answers:
            silent = 1e-9 * max(device.gap, now - device.reply_time) - device.report_period
        elif device.transit.silent_since >= 0:
            # with replies on their way, a silence begins where the next one is missing
            silent = 1e-9 * (now - device.transit.silent_since
                - (0 if device.transit.silent_early else longest_transit(&device.transit)))
        else:
            return False
        return silent > permitted - 1e-9

    cdef int command(self) noexcept nogil:
        """Encode the frames of each device into `outgoing`, bus by bus.

        Returns OK, the status of a device that cannot encode, or HUNG if the watchdog has taken the devices.
        """
        cdef int number, count
        cdef int total = 0
        cdef Device *device
        cdef const double *arena = self.table.arena
        memset(self.outgoing_count, 0, self.buses.count * sizeof(int32_t))
        for number in range(self.table.count):
            device = &self.table.devices[number]
            if device.drive.disabled >= 0 and self.switch.update(number) == HUNG:
                return HUNG
            count = end_zeroing(self.table, self.drives, self.events, number)
            if count >= 0:
                count = self.encode(device, &self.outgoing[total])
            if device.drive.state != ACTIVE:
                count = 0                                        # neither commanded nor checked
            if count < 0:
                self.table.failed = number
                return -count
            if watch_transit(&device.transit, <int64_t>arena[TICK], <int64_t>(1e9 * arena[PERIOD]), count == 1
                    and device.transit_slot >= 0 and not self.table.waiting
                    and device.drive.state == ACTIVE and not all_ones(self.outgoing[total].data, 6),
                    is_stiff(arena, device.stiffness, device.damping_command)):
                self.outgoing[total + 1] = self.outgoing[total]
                count = 2
            count = add_zero(self.table, self.events, number, &self.outgoing[total], count)
            device.sends = count
            total += count
            if device.twins.period == 0:
                note_questions(&device.twins, count, self.table.now)
            self.outgoing_count[device.bus] += count
            if self.laps != NULL and self.laps.each != NULL:
                lap(self.laps, self.item + number)
        if self.laps != NULL and self.laps.each == NULL and self.table.count > 0:
            lap(self.laps, COMMAND)
        return OK

    cdef int encode(self, Device *device, Frame *frames) noexcept nogil:
        """Encode the frames of a device, with zero torque while its zero is set and while it is taken out.

        Returns their number, or a negated status.
        """
        cdef double *arena = self.table.arena
        cdef double share = arena[AUTHORITY]
        cdef double faded = 1.0
        cdef int count
        if device.fades_from >= 0:
            if self.fade > 0.0:
                faded = (arena[TICK] - device.fades_from) * arena[PERIOD] / self.fade
            if faded >= 1.0:
                device.fades_from = -1
            else:
                arena[AUTHORITY] = share * max(faded, 0.0)
        if device.zeroing.runs or device.drive.state != ACTIVE:
            arena[AUTHORITY] = 0.0
        count = device.encode(arena, device.encode_slots, device.encode_sizes, frames)
        arena[AUTHORITY] = share
        if device.zeroing.position >= 0:
            note_command(&device.zeroing, arena, self.table.now)
        return count

    cdef int transmit(self, int64_t now) noexcept nogil:
        """Send the frames of `command`, and those of the drives that are taken out or return."""
        cdef int bus, status
        cdef int first = 0
        cdef int64_t sent = now
        for bus in range(self.buses.count):
            if self.table.timed:
                sent = monotonic() - self.buses.began       # a drive can reply before the call returns
            status = self.buses.send(bus, &self.outgoing[first], self.outgoing_count[bus], now, False)
            if status != OK:
                return status
            first += self.outgoing_count[bus]
            self.note_commands(bus, now, sent)
        return self.switch.send(now)

    cdef void note_commands(self, int bus, int64_t at, int64_t sent) noexcept nogil:
        """Start timing the replies of a bus's devices.

        at : ns of the frames; sent : ns before they were sent
        """
        cdef int number
        cdef Device *device
        for number in range(self.table.count):
            device = &self.table.devices[number]
            if device.bus != bus:
                continue
            device.pumped = at
            if device.zero.count:
                if device.owed and device.drive.state == ACTIVE and self.table.arena[TICK] >= self.counted_from:
                    device.missed += 1
                    if self.buses.layout != NULL:
                        store_i64(&self.buses.layout.lost_replies[number], device.missed)
                device.owed = True
            if device.drive.state == ACTIVE:
                note_asked(&device.transit, device.sends, at, sent, <int64_t>self.table.arena[TICK])


cdef inline int64_t sampled_since(const Device *device) noexcept nogil:
    """Return the time in ns from which on the newest sample is, unless replies have become late."""
    return device.transit.likely if device.transit.answers and device.transit.likely >= 0 else device.reply_time


cdef inline int64_t silent_from(const Device *device, int64_t time) noexcept nogil:
    """Return since when in ns a reply was due that arrives at `time`."""
    if not device.transit.answers:
        return device.reply_time
    return device.transit.silent_since if device.transit.silent_since >= 0 else time


cdef inline void note_reply(Device *device, const Frame *frame, bint counts, int64_t tick, bint timed) noexcept nogil:
    """Note a reply or sample.

    counts : whether it is one that arming waits for
    timed : whether it answers the command of a tick
    """
    cdef int index
    device.owed = device.doubtful = False
    if device.answered and device.reply_time >= device.enabled_since:   # not over the wait for the operator
        device.gap = max(device.gap, frame.time - silent_from(device, frame.time))
    device.answered = True
    device.reply_time = frame.time
    device.replies += counts
    note_arrival(&device.transit, frame.time)
    if device.transit.pending == 0:
        for index in range(device.transit.uncertain if timed and device.latency != NULL else 0):
            add(device.latency, device.transit.replies[index], tick)
        device.transit.uncertain = 0
