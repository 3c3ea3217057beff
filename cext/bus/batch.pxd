"""Batches of frames that were encoded at compile time."""

from libc.stdint cimport uint8_t, uint32_t

from cext.abi cimport EXTENDED, FRAME_BYTES, FRAMES_PER_BATCH, Frame

cdef struct Batch:
    Frame frames[FRAMES_PER_BATCH]
    int count


cdef inline int load_batch(Batch *batch, frames) except -1:
    """Fill a batch. frames : list of (arbitration id, is extended, data)"""
    cdef Frame *frame
    cdef int index, position
    if len(frames) > FRAMES_PER_BATCH:
        raise ValueError("at most %d frames a device, not %d" % (FRAMES_PER_BATCH, len(frames)))
    batch.count = len(frames)
    for index, (identifier, extended, data) in enumerate(frames):
        frame = &batch.frames[index]
        if len(data) > FRAME_BYTES:
            raise ValueError("a frame carries at most %d bytes, not %d" % (FRAME_BYTES, len(data)))
        frame.id = <uint32_t>identifier | (<uint32_t>EXTENDED if extended else 0)
        frame.length = <uint8_t>len(data)
        for position, byte in enumerate(data):
            frame.data[position] = byte
    return 0
