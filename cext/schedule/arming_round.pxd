"""Arming of one device: the frames of a round, and the replies that it waits for. Its phases are in
cext.schedule.device_arming.
"""

from libc.stdint cimport int64_t

from cext.abi cimport IDLE, OK
from cext.safety.transit cimport measure_again, note_asked
from cext.safety.twins cimport note_questions
from cext.schedule.buses cimport Buses
from cext.schedule.device_events cimport DeviceEvents
from cext.schedule.device_table cimport Device, DeviceTable
from cext.schedule.drive_zeroing cimport zero_while_arming


cdef inline void begin_asking(DeviceTable table, Device *device, bint looked) noexcept nogil:
    """Begin to ask a device. looked : whether it must reply although nothing is to be read back"""
    cdef bint asked = device.ask.count > 0 and (looked or device.zeroing.due)
    cdef bint sends = device.zero.count == 0 and device.timeout > 0.0       # a sensor that is checked for silence
    if device.ready >= 0:
        table.arena[device.ready] = 0.0
    device.enabling = False
    device.replies = device.rounds = 0
    device.replies_wanted = 1 if asked or sends else 0


cdef inline void begin_enabling(Device *device, int64_t now) noexcept nogil:
    measure_again(&device.transit)
    device.enabling = True
    device.enabled_since = now
    device.gap = 0
    device.replies = device.rounds = 0
    device.replies_wanted = device.zero.count


cdef inline bint counts(const Device *device, int answer) noexcept nogil:
    """Return whether a reply is one that arming waits for. answer : of the device's decode

    A drive that has not obeyed the frames that disable it must not be armed, so its replies do not count.
    """
    if answer == IDLE:
        return not device.enabling
    return device.enabling or not device.reports_enabled


cdef inline int send_round(
        DeviceTable table, Buses buses, DeviceEvents events, int number, bint set_up, int64_t now) noexcept nogil:
    """Send the frames of a round. Returns the combined status of the sends.

    Many frames are sent less often, to limit the load of the bus. set_up : whether settings are written that are not
    read back yet
    """
    cdef Device *device = &table.devices[number]
    cdef int status = OK
    cdef int64_t questions = device.zero.count if device.enabling else device.ask.count
    cdef int64_t without_sample = 0
    if device.enabling:
        if device.enable.count > 0 and not table.has_replied(device):
            if device.rounds % device.enable.count == 0:
                status |= buses.send(device.bus, device.enable.frames, device.enable.count, now, False)
                questions += device.enable.count
            device.rounds += 1
        status |= buses.send(device.bus, device.zero.frames, device.zero.count, now, False)
        if device.twins.period == 0:
            note_questions(&device.twins, questions, now)
        note_asked(&device.transit, questions, now, now, -1)
        return status
    if set_up and device.set_up.count > 0 and not table.has_replied(device):
        if device.rounds % device.set_up.count == 0:
            status |= buses.send(device.bus, device.set_up.frames, device.set_up.count, now, False)
            questions += device.set_up.count
            without_sample = device.set_up.count - device.set_up_replies
        device.rounds += 1
    status |= buses.send(device.bus, device.ask.frames, device.ask.count, now, False)
    if zero_while_arming(table, events, number):
        status |= buses.send(device.bus, device.set_zero.frames, device.set_zero.count, now, False)
        questions += device.set_zero.count
    if device.twins.period == 0 or device.twins.answers_disable:
        note_questions(&device.twins, questions, now)
    note_asked(&device.transit, questions - without_sample, now, now, -1)
    return status
