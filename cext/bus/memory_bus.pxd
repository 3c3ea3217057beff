from cext.abi cimport Bus, Frame

cdef enum:
    QUEUE = 1024

cdef struct Queue:
    long head, tail
    long dropped
    Frame frames[QUEUE]

cdef struct End:                 # end of a memory bus: reads one queue, writes the other
    Queue *inbox
    Queue *outbox

cdef class BusEnd:
    """One end of a bus, for the executor."""
    cdef Bus bus
    cdef object owner            # keeps the memory behind the context alive
    cdef bint switching          # whether sent frames of CAN FD switch to the data bitrate

cdef class MemoryBus:
    cdef Queue *queues
    cdef End ends[2]
    cdef readonly BusEnd host, device
    cdef _wire(self, BusEnd end, int index)
