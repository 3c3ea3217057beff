# cython: freethreading_compatible=True
"""Warning bits of drives: each becomes an event of the recording once a run, at most one per drive and tick."""

from libc.stdlib cimport calloc, free
from libc.string cimport memset

from cext.memory.event_template cimport EventTemplate


cdef class DriveWarnings:
    """Warnings of the devices of a `graph.Schedule` with an output `warning`."""

    def __cinit__(self, schedule):
        reporting = [device for device in schedule.devices if device.warning >= 0]
        self.count, self.news, self.most = len(reporting), [], 0
        self.slots = <int *>calloc(max(1, self.count), sizeof(int))
        self.reported = <uint32_t *>calloc(max(1, self.count), sizeof(uint32_t))
        self.texts = <void **>calloc(max(1, self.count) * WARNING_BITS, sizeof(void *))
        if self.slots == NULL or self.reported == NULL or self.texts == NULL:
            raise MemoryError
        for place, device in enumerate(reporting):
            self.slots[place] = device.warning
            mine = [EventTemplate({"event": "warning", "device": device.name,
                "what": words}) for words in device.warnings]
            if len(mine) != WARNING_BITS:
                raise ValueError(f"{device.name} has {len(mine)} texts for {WARNING_BITS} bits of warnings")
            for bit, each in enumerate(mine):
                self.texts[place * WARNING_BITS + bit] = <void *>each
            self.most += max(8 + (<EventTemplate>each).size() for each in mine)
            self.news += mine

    def __dealloc__(self):
        free(self.slots); free(self.reported); free(self.texts)

    cdef void reset(self) noexcept nogil:
        memset(self.reported, 0, self.count * sizeof(uint32_t))

    cdef uint64_t share(self, SharedLayout *layout):
        """Set the shared state for events, or NULL. Returns the ring bytes that one tick may need."""
        self.layout = layout
        return self.most

    cdef void look(self, double *arena, int64_t tick) noexcept nogil:
        cdef int place, bit
        cdef uint32_t fresh
        cdef double warning
        for place in range(self.count):
            warning = arena[self.slots[place]]
            if not 0.0 < warning < 4294967296.0:
                continue
            fresh = <uint32_t>warning & ~self.reported[place]
            if fresh == 0:
                continue
            for bit in range(WARNING_BITS):
                if fresh >> bit & 1:
                    (<EventTemplate>self.texts[place * WARNING_BITS + bit]).publish(self.layout, tick)
                    self.reported[place] |= <uint32_t>1 << bit
                    break
