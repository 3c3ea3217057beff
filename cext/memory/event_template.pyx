# cython: freethreading_compatible=True
"""Events that the tick itself emits: the text is prepared before the run, and the tick inserts its number."""

import json

from libc.stdint cimport uint32_t
from libc.stdio cimport snprintf
from libc.string cimport memcpy, memset

from cext.memory.shared_state cimport EVENT, commit, reserve

cdef enum:
    TICK_DIGITS = 20                # with the sign


cdef class EventTemplate:
    """One event of the recording, with space for the tick.

    event : dict that can be encoded as JSON; "tick" is added
    """

    def __cinit__(self, dict event):
        self.text = json.dumps(event).encode()[:-1] + b', "tick": '
        self.begin, self.length = self.text, len(self.text)

    cdef size_t size(self) noexcept nogil:
        """Return the bytes of the record in the ring, a multiple of 8."""
        return (self.length + TICK_DIGITS + 1 + 7) // 8 * 8

    cdef void publish(self, SharedLayout *layout, int64_t tick) noexcept nogil:
        """Write the event to the ring, padded with spaces. `layout` may be NULL."""
        cdef char[TICK_DIGITS + 1] digits
        cdef char *room
        if layout == NULL:
            return
        room = <char *>reserve(layout, EVENT, <uint32_t>self.size())
        if room == NULL:
            layout.dropped += 1
            return
        memset(room, 32, self.size())
        memcpy(room, self.begin, self.length)
        memcpy(room + self.length, digits, snprintf(digits, sizeof(digits), "%lld", <long long>tick))
        room[self.size() - 1] = 125                             # }
        commit(layout)
