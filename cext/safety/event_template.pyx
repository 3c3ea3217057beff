# cython: freethreading_compatible=True
"""Events that the tick itself tells of: their words are made before the run, the tick fills in its number."""

import json

from libc.stdint cimport uint32_t
from libc.stdio cimport snprintf
from libc.string cimport memcpy, memset

from cext.safety.shared_state cimport EVENT, commit, reserve

cdef enum:
    MOST_DIGITS = 20                # of a tick, with its sign


cdef class News:
    """One event of the recording.

    event : dict that JSON can carry; "tick" is added
    """

    def __cinit__(self, dict event):
        self.text = json.dumps(event).encode()[:-1] + b', "tick": '
        self.begin, self.length = self.text, len(self.text)

    cdef size_t size(self) noexcept nogil:
        """Bytes of the record in the ring: a multiple of 8."""
        return (self.length + MOST_DIGITS + 1 + 7) // 8 * 8

    cdef void tell(self, PageLayout *page, int64_t tick) noexcept nogil:
        """Into the ring, with spaces where the number of the tick is shorter than it may be. `page` may be NULL."""
        cdef char[MOST_DIGITS + 1] digits
        cdef char *room
        if page == NULL:
            return
        room = <char *>reserve(page, EVENT, <uint32_t>self.size())
        if room == NULL:
            page.dropped += 1
            return
        memset(room, 32, self.size())
        memcpy(room, self.begin, self.length)
        memcpy(room + self.length, digits, snprintf(digits, sizeof(digits), "%lld", <long long>tick))
        room[self.size() - 1] = 125                             # }
        commit(page)
