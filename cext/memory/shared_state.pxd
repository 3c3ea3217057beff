"""Shared state of a run: what the control process shows to other processes, and the ring of its recording.

One memory file, mapped by every process of a run: the layout below, the ring, then the live parameters. The control
process writes and the others read; only `fence`, `guard`, the requests of the operator, the mailbox and the tails of the
rings go in the other direction. A tick takes no locks here.

Any of these processes may be defective and write anything at any time. What decides where this process reads and writes
is therefore private: `Own`, in front of the mapping. What it reads from the layout is copied once and then limited.
"""

from libc.stdint cimport int32_t, int64_t, uint32_t, uint64_t

from cext.abi cimport Frame
from cext.atomics cimport load_i32, load_i64, load_u64, store_i32, store_i64, store_u64, swap_i32
from cext.clock.histogram cimport Histogram
from cext.memory.robust_mutex cimport pthread_mutex_t
from cext.ring.keys cimport KeyRing
from cext.ring.mailbox cimport Mailbox
from cext.ring.operator cimport Operator

cdef enum:
    INIT = 0
    ARMING = 1
    RUNNING = 2
    STOPPING = 3
    SAFE = 4
    READY = 5                   # waiting for confirmation: every device has replied
    WAITING = 6                 # after a fault: safe, until armed again

cdef enum:
    OUT_WORDS = 16
    DEVICE_LIMIT = 1024         # devices of a schedule, 64 a word

cdef enum: # of the fence
    FENCED_HERE = 1             # by the loop, which may lower it to arm again
    FENCED_FOR_GOOD = 2         # by another process: permanent

cdef enum: # why a page of the panel has lost the controls
    PAGE_SILENT = 1             # it has not confirmed new values for too long
    PAGE_CLOSED = 2             # it has closed its connection, as when it is left or reloaded
    PAGE_CUT = 3                # its connection has ended without being closed
    PAGE_TAKEN = 4              # another page has taken the controls
    PAGE_RETURNED = 5           # it has given them back
    PAGE_ENDED = 6              # the panel ends

cdef enum: # of a record in the ring
    PADDING = 0                 # up to the end of the ring
    ROW = 1                     # doubles: tick, lateness in s, then the recorded signals
    FRAME = 2                   # a struct Frame
    EVENT = 3                   # JSON
    RECEIVED = 4                # int64: ns from the start of the run of a drain of the buses; its frames follow
    CHANGE = 5                  # structs Change: requests of the mailbox that took effect in one tick

cdef struct Header:             # in front of every record
    uint32_t kind
    uint32_t bytes              # of the payload, a multiple of 8

cdef struct SharedLayout:
    uint64_t magic
    uint64_t capacity           # of the ring, bytes, a power of two
    int32_t state
    int32_t fence               # while it is not 0, no process sends a command frame
    int32_t closed              # 1: no further records
    int32_t status              # reason for the end
    int32_t hung                # 1 + stopwatch item of a tick that hung, -1 if unknown, 0: none
    int32_t crashed             # number of a fatal signal of the control process; `hung` is then the item at that time
    int32_t at                  # stopwatch item that the loop executes, below 0: none
    int64_t asleep              # ns for which the computer had been suspended before the run began
    int64_t pause_limit         # ns from the beat after which the loop was paused; 0: not judged
    int64_t paused              # ns for which the loop was paused, with its guardian; 0 if it was not
    # drives that are taken out and not damped any more: bit k % 64 of word k / 64 for device k of the schedule
    uint64_t out[OUT_WORDS]
    pthread_mutex_t hold        # held by the loop's thread from before the guardian starts until after it has ended
    pthread_mutex_t guard_hold  # held by the guardian's thread
    int32_t guard_dead          # 1: the guardian's thread has died
    int32_t guard_stops         # 1: the guardian stops the actuators, and judges their replies
    int64_t control             # ID of the control process
    int64_t beat                # ns of CLOCK_MONOTONIC at which the loop's newest round or tick began
    int64_t program_limit       # ns for which the loop of a connected program may be silent; 0 without one
    int64_t program             # ns of CLOCK_MONOTONIC of the newest pass of that loop
    int64_t guard               # ns of CLOCK_MONOTONIC of the guardian's newest check; 0 without one
    int64_t live_count          # live parameters
    int64_t live_bytes          # of the JSON that describes them
    int64_t began               # ns of CLOCK_MONOTONIC of the start of the run, the zero of frame times
    int64_t wall                # ns of CLOCK_REALTIME of the start of the run
    int64_t first_tick          # ns from the start of the run to tick 0, the zero of row times
    int64_t tick                # last completed one
    int64_t ticks               # number of completed ones
    int64_t missed              # skipped grid points
    int64_t dropped             # records lost to a full ring
    int64_t frames_received
    int64_t frames_sent
    int64_t frames_foreign      # frames that no device accepted
    int64_t frames_malformed
    int64_t caught_up           # ticks that ran after their next grid point
    int64_t gil_taken           # acquisitions of the GIL in ticks
    int64_t sleeps
    int64_t spins
    int64_t waited              # ns spent waiting for the recorder, in virtual time only
    Histogram lateness          # of the wake-up after its grid point
    Histogram period            # |period - T|
    Histogram execution         # of a tick
    Histogram gil               # waits for it
    Histogram bus               # receiving and sending
    uint64_t head               # bytes written, in total; owned by the producer
    uint64_t spare[7]           # keeps both ends on separate cache lines
    uint64_t tail               # bytes read, in total; owned by the consumer
    uint64_t more[7]
    Mailbox mailbox
    Operator operator
    KeyRing keys
    int32_t sending             # not 0: the loop has checked the fence, and may be sending commands
    # the page of the panel that has the controls: written by the panel, except for `lost_page`
    int32_t page                # its number
    int64_t page_link           # ns of CLOCK_MONOTONIC since when it has them and confirms values; 0: no such page
    int64_t page_beat           # ns of CLOCK_MONOTONIC of the newest values that it has confirmed
    int64_t page_process        # ID of the process of the panel
    int64_t page_loss           # the newest loss: why | number of the page << 8 | number of the page that took them << 32
    int64_t lost_page           # the loss that the loop has found, in the same form
    int64_t lost_replies[DEVICE_LIMIT]      # of each device of the schedule: commands without a reply before the next

cdef struct Own:                # of one process, in front of its mapping of the layout
    uint64_t capacity           # of the ring
    uint64_t head               # of the ring, if this process is its producer
    uint64_t reserved           # bytes from there to the end of the record that is being written
    int64_t live_count, live_bytes
    size_t size                 # of the whole mapping, with the memory in front of the layout
    void *begin                 # start of the mapping

cdef struct Shown:              # a live parameter, after the ring; the JSON follows them
    double value                # in the newest tick
    double target               # of its ramp

cdef inline Own *own(const SharedLayout *layout) noexcept nogil:
    return <Own *>(<char *>layout - sizeof(Own))

cdef inline char *ring(SharedLayout *layout) noexcept nogil:
    return <char *>layout + sizeof(SharedLayout)

cdef inline uint64_t offset_of(SharedLayout *layout, uint64_t place) noexcept nogil:
    """Return the offset in the ring of a head, tail or cursor: with space for a header, whatever the place."""
    return place & (own(layout).capacity - 1) & ~<uint64_t>7

cdef inline Header *record_at(SharedLayout *layout, uint64_t place) noexcept nogil:
    """Return the record of the ring at a head, tail or cursor."""
    return <Header *>(ring(layout) + offset_of(layout, place))

cdef inline bint read_header(SharedLayout *layout, uint64_t place, uint64_t head, Header *copy) noexcept nogil:
    """Copy the header of a record. Returns whether the record lies between `place` and `head`, and in the ring."""
    cdef uint64_t size
    copy[0] = record_at(layout, place)[0]
    size = sizeof(Header) + <uint64_t>copy.bytes
    return place % 8 == 0 and size % 8 == 0 and size <= head - place <= own(layout).capacity and (
        offset_of(layout, place) + size <= own(layout).capacity)

cdef inline Shown *shown(SharedLayout *layout) noexcept nogil:
    return <Shown *>(ring(layout) + own(layout).capacity)

cdef inline bint page_is_linked(SharedLayout *layout, int64_t now, int64_t limit) noexcept nogil:
    """Return whether a page has the controls, and has confirmed values that are at most `limit` ns old.

    now : ns of CLOCK_MONOTONIC
    """
    cdef bint linked = load_i64(&layout.page_link) != 0
    return linked and -limit <= now - load_i64(&layout.page_beat) <= limit

cdef inline void set_out(SharedLayout *layout, int device, bint out) noexcept nogil:
    """Show whether a drive is taken out. device : number in the schedule, below DEVICE_LIMIT"""
    cdef uint64_t *word = &layout.out[device >> 6]
    cdef uint64_t bit = <uint64_t>1 << (device & 63)
    if (word[0] & bit != 0) != out:
        store_u64(word, word[0] ^ bit)

cdef inline void *reserve(SharedLayout *layout, uint32_t kind, uint32_t size) noexcept nogil:
    """Return space for one record, NULL if the ring is full.

    size : a multiple of 8. Nothing is visible before `commit`.
    """
    cdef Own *mine = own(layout)
    cdef uint64_t used = mine.head - load_u64(&layout.tail)
    cdef uint64_t to_end = mine.capacity - offset_of(layout, mine.head)
    cdef uint64_t need = sizeof(Header) + <uint64_t>size
    cdef Header *header
    if used > mine.capacity or need + (to_end if need > to_end else 0) > mine.capacity - used:
        return NULL
    if need > to_end:                       # a record never wraps: pad to the end and start over
        header = record_at(layout, mine.head)
        header.kind = PADDING
        header.bytes = <uint32_t>(to_end - sizeof(Header))
        mine.head += to_end
        store_u64(&layout.head, mine.head)
    header = record_at(layout, mine.head)
    header.kind = kind
    header.bytes = size
    mine.reserved = need
    return <char *>header + sizeof(Header)

cdef inline void commit(SharedLayout *layout) noexcept nogil:
    own(layout).head += own(layout).reserved
    store_u64(&layout.head, own(layout).head)

cdef object damaged(uint64_t place)

cdef class SharedState:
    cdef SharedLayout *layout
    cdef readonly int fd
    cdef uint64_t cursor            # bytes that `drain` has read; the ring's tail follows
    cdef bint made_here             # created by this process
    cdef bint held                  # a thread of this process has the loop's mutex
    cdef bint guarding              # a thread of this process has the guardian's mutex

    cdef int map_file(self, uint64_t capacity, int64_t live_count, int64_t live_bytes) except -1
    cpdef let_go(self)
