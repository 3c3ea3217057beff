# cython: freethreading_compatible=True
"""Devices of a schedule in native memory: kernels with their tables, frames encoded at compile time, replies."""

from libc.stdint cimport uintptr_t
from libc.stdlib cimport calloc, free
from libc.string cimport memset

from cext.bus.batch cimport load_batch
from cext.safety.drive_state cimport OUT, forget_state
from cext.memory.shared_state cimport DEVICE_LIMIT
from cext.safety.speed_bands cimport SpeedBands
from cext.safety.stop_confirmation cimport StopConfirmation
from cext.safety.thresholds cimport STOP_LISTEN_LIMIT
from cext.safety.transit cimport forget_transit
from cext.safety.twins cimport forget_twins, may_be_two
from cext.safety.zeroing cimport forget_zero

from cext.schedule.kernel_table import address, words


cdef class DeviceTable:
    """Devices of a `graph.Schedule`.

    Parameters
    ----------
    schedule : graph.Schedule
    memory : the arena, an array of doubles that outlives this object
    """

    def __init__(self, schedule, memory):
        self.schedule, self.memory, self.keep = schedule, memory, []
        self.arena = <double *><uintptr_t>memory.ctypes.data
        self.failed = -1
        self.load()

    def __dealloc__(self):
        for index in range(self.count):
            free(self.devices[index].latency)
        free(self.devices)

    cdef int load(self) except -1:
        devices = self.schedule.devices
        self.devices = <Device *>calloc(max(1, len(devices)), sizeof(Device))
        self.count = len(devices)
        if self.count > DEVICE_LIMIT:
            raise ValueError(f"at most {DEVICE_LIMIT} devices in a diagram, not {self.count}")
        for index, entry in enumerate(devices):              # the schedule lists them bus by bus
            self.load_device(&self.devices[index], entry)
        return 0

    cdef int load_device(self, Device *device, entry) except -1:
        """Copy a device. entry : graph.schedule.DeviceSteps"""
        device.decode = <decode_t><uintptr_t>address(entry.decode, "decode")
        device.encode = <encode_t><uintptr_t>address(entry.encode, "encode")
        self.keep += [entry.decode, entry.encode]
        tables = [
            words(table) for pair in (entry.decode_table, entry.encode_table) for table in (pair.slots, pair.sizes)]
        self.keep += tables
        device.decode_slots = <int32_t *><uintptr_t>tables[0].ctypes.data
        device.decode_sizes = <int32_t *><uintptr_t>tables[1].ctypes.data
        device.encode_slots = <int32_t *><uintptr_t>tables[2].ctypes.data
        device.encode_sizes = <int32_t *><uintptr_t>tables[3].ctypes.data
        device.bus, device.age, device.fault, device.timeout = entry.bus, entry.age, entry.fault, entry.timeout
        device.transit_slot, device.transit.answers = entry.transit, entry.answers
        device.stiffness = -1 if entry.watch is None else entry.watch.stiffness
        device.damping_command = -1 if entry.watch is None else entry.watch.damping
        device.max_transit, device.restart_time = entry.max_transit, entry.restart_time
        device.report_period = entry.report_period
        device.unseen = 0.0 if entry.answers else entry.max_transit
        device.set_up_replies = entry.set_up_replies
        device.ready, device.ready_size = entry.ready, entry.ready_size
        if entry.ready_size > READY_NUMBERS:
            raise ValueError(f"{entry.name}: at most {READY_NUMBERS} values outlive the start, not {entry.ready_size}")
        device.reports_enabled = entry.reports_enabled
        load_batch(&device.ask, entry.ask)
        load_batch(&device.set_up, entry.set_up)
        for place, frame in enumerate(entry.set_up):
            device.only_reads[place] = frame in entry.reads
        load_batch(&device.enable, entry.enable)
        load_batch(&device.zero, entry.zero)
        load_batch(&device.disable, entry.disable)
        device.unanswered = entry.unanswered
        if entry.zero or entry.disable:
            confirmation = StopConfirmation(entry.stop_reply)
            self.keep.append(confirmation)
            device.confirmation = <void *>confirmation
            reply = entry.stop_reply
            # a device may report by itself and answer, as it is set, and only what it states is counted
            device.twins.counted = reply is not None and reply.torque is not None and (
                entry.answers or entry.report_period > 0.0 or not reply.reports)
            device.twins.period = round(entry.report_period * 1e9)
            device.twins.answers_disable = reply is not None and bool(reply.echo)
        device.relay = round(entry.relay_time * 1e9)
        device.drive.disabled, device.drive.disable = entry.disabled_slot, entry.disable_slot
        device.drive.active = entry.active_slot
        if entry.zeroing is not None:
            load_batch(&device.set_zero, [entry.zeroing.zeroing.frame])
        self.load_zeroing(&device.zeroing, entry.zeroing)
        if entry.damp is not None:
            bands = SpeedBands(entry.damp.bands, round(entry.damp.round * 1e9), entry.damp.acceleration,
                entry.damp.velocity, round(entry.damp.transit * 1e9))
            self.keep.append(bands)
            device.bands = <void *>bands
            device.damping = round(entry.damp.duration * 1e9)
        return 0

    cdef int load_zeroing(self, Zeroing *z, entry) except -1:
        """Set how the zero of a device is set. entry : graph.schedule.ZeroSteps, or None"""
        z.position = z.request = z.law = z.current = -1
        if entry is not None:
            z.position, z.request, z.law, z.current = entry.position, entry.request, entry.law, entry.current
            z.offset, z.torque_code = entry.zeroing.offset, entry.zeroing.torque_code
            z.at_arming = entry.zeroing.at_arming
        return 0

    cdef int time_replies(self) except -1:
        """Time the reply of every device to each command from now on."""
        self.timed = True
        for index in range(self.count):
            if self.devices[index].latency == NULL and self.devices[index].zero.count:
                self.devices[index].latency = <Histogram *>calloc(1, sizeof(Histogram))
                if self.devices[index].latency == NULL:
                    raise MemoryError
        return 0

    cdef void reset(self):
        """Restore the state before the first arming."""
        cdef int index
        cdef Device *device
        self.now = 0
        self.failed = -1
        self.waiting = self.stopping = self.arming = False
        for index in range(self.count):
            device = &self.devices[index]
            forget_transit(&device.transit)
            device.enabling = device.was_enabled = False
            forget_zero(&device.zeroing)
            forget_state(&device.drive, self.arena)
            forget_twins(&device.twins, 0, 0)
            device.fades_from = -1
            device.reply_time = device.replies = device.replies_wanted = device.missed = 0
            device.owed = device.answered = device.doubtful = False
            device.gap = 0
            memset(device.malformed, 0, sizeof(device.malformed))
            if device.bands != NULL:
                (<SpeedBands>device.bands).forget()
            if device.latency != NULL:
                memset(device.latency, 0, sizeof(Histogram))

    cdef bint has_replied(self, const Device *device) noexcept nogil:
        """Return whether a device has replied, and returned what arming writes to it."""
        return device.replies >= device.replies_wanted and (device.ready < 0 or self.arena[device.ready] != 0.0)

    cdef bint may_answer_late(self, const Device *device) noexcept nogil:
        """Return whether an answer to a disable may still come: during the run, it reports a drive that has stopped."""
        return device.enabling and device.twins.period > 0 and device.twins.answers_disable and (
            self.now - device.enabled_since < STOP_LISTEN_LIMIT)

    cdef bint may_come_in_bursts(self, const Device *device) noexcept nogil:
        """Return whether replies were not watched for long enough to exclude gaps in which a drive could restart."""
        return self.arming and self.looked and device.enabling and device.restart_time > 0.0 and (
            self.now - device.enabled_since < 2 * STOP_LISTEN_LIMIT)

    cdef bint has_answered(self, const Device *device) noexcept nogil:
        """Return whether arming or the safe stop need not wait for a device any longer."""
        if self.stopping:
            return device.confirmation == NULL or (<StopConfirmation>device.confirmation).confirmed
        return device.drive.state == OUT or (
            self.has_replied(device) and (device.enabling or not device.zeroing.due)
            and not self.may_answer_late(device)
            and not self.may_come_in_bursts(device)
            and not (self.arming and may_be_two(&device.twins, device.enable.count > 0, self.now)))

    cdef bint all_answered(self) noexcept nogil:
        """Return whether arming or the safe stop waits for no device any longer."""
        cdef int number
        for number in range(self.count):
            if not self.has_answered(&self.devices[number]):
                return False
        return True
