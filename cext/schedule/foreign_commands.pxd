"""Detection of commands of another controller, by id and length of the own commands.

Principle
    1. Replies and commands of MIT mode share id and length and differ in the first byte only.
    2. A drive replies to every command, also of another controller. If another controller commands it, replies with its
       own id arrive as well, and the next of them shows that the frame before was a command.
    3. Until then, a frame may be a reply if one is due. If none is due, or if the frame equals one of the own commands,
       it is a command.
"""

from libc.string cimport memcmp

from cext.abi cimport Frame
from cext.bus.batch cimport Batch
from cext.schedule.device_table cimport Device, DeviceTable


cdef inline int commanded_device(DeviceTable table, const Frame *frame) noexcept nogil:
    """Return the device that a frame other than a reply commands; -1 for none."""
    cdef int number
    cdef Device *device
    for number in range(table.count):
        device = &table.devices[number]
        if device.bus == frame.bus and (
                is_like(&device.zero, frame, NULL) or is_like(&device.disable, frame, NULL)
                or is_like(&device.ask, frame, NULL) or is_like(&device.enable, frame, NULL)
                or is_like(&device.set_up, frame, device.only_reads)):
            return number
    return -1


cdef inline bint may_be_reply(const Device *device, const Frame *frame) noexcept nogil:
    """Return whether a frame with the id and length of own commands may be the drive's reply with another id or length.
    """
    return (device.owed or not device.answered) and not (
        is_same(&device.zero, frame) or is_same(&device.disable, frame) or is_same(&device.ask, frame)
        or is_same(&device.enable, frame) or is_same(&device.set_up, frame))


cdef inline bint is_like(const Batch *batch, const Frame *frame, const bint *left_out) noexcept nogil:
    """Return whether a frame has the id and length of one of a batch. left_out : frame not to compare, or NULL"""
    cdef int index
    for index in range(batch.count):
        if left_out != NULL and left_out[index]:
            continue
        if batch.frames[index].id == frame.id and batch.frames[index].length == frame.length:
            return True
    return False


cdef inline bint is_same(const Batch *batch, const Frame *frame) noexcept nogil:
    """Return whether a frame equals one of a batch."""
    cdef int index
    for index in range(batch.count):
        if (batch.frames[index].id == frame.id and batch.frames[index].length == frame.length
                and memcmp(batch.frames[index].data, frame.data, frame.length) == 0):
            return True
    return False
