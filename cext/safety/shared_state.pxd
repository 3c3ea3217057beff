"""The shared page: what the control process shows to the others, and the ring that its recording runs through.

One memory file, mapped by every process of a run: the layout below, the ring, then what there is to know of live parameters. The
control process writes, the others read; only `fence`, `guard`, the mailbox and the ring's tail go the other way. Nothing here is locked in a tick.
"""

from libc.stdint cimport int32_t, int64_t, uint32_t, uint64_t

from cext.abi cimport Frame
from cext.atomics cimport load_i32, load_i64, load_u64, store_i32, store_i64, store_u64, swap_i32
from cext.clock.histogram cimport Histogram
from cext.safety.robust_mutex cimport pthread_mutex_t
from cext.ring.mailbox cimport Mailbox

cdef enum:
    INIT = 0
    ARMING = 1
    RUNNING = 2
    STOPPING = 3
    SAFE = 4
    READY = 5                   # armed but for somebody's word: every device has answered
    WAITING = 6                 # after a fault: safe, until somebody arms again

cdef enum: # of the fence
    FENCED_HERE = 1             # by the loop, which may lower it to arm again
    FENCED_FOR_GOOD = 2         # by any other process: nobody lowers it

cdef enum: # of a record in the ring
    PADDING = 0                 # the rest of the ring, up to its end
    ROW = 1                     # doubles: tick, lateness in s, then the recorded signals
    FRAME = 2                   # a struct Frame
    EVENT = 3                   # JSON
    RECEIVED = 4                # int64: ns from the run's begin at which the buses were drained; the frames that were there follow
    CHANGE = 5                  # structs Change: what the mailbox has brought in one tick

cdef struct Header:             # in front of every record
    uint32_t kind
    uint32_t bytes              # of the payload, a multiple of 8

cdef struct PageLayout:
    uint64_t magic
    uint64_t capacity           # of the ring, bytes, a power of two
    int32_t state
    int32_t fence               # while it is not 0, no process sends a command frame
    int32_t closed              # 1: nothing will be pushed any more
    int32_t status              # why it stopped
    int32_t hung                # 1 + item of the stopwatch with which a tick hung, -1 where that is not known, 0: none did
    int32_t crashed             # number of the signal that kills the control process from within; then `hung` is what it was working on
    pthread_mutex_t hold        # the loop's thread has it from before the guardian is there until after that has gone
    pthread_mutex_t guard_hold  # the guardian's thread has it as long as it lives
    int32_t guard_dead          # 1: it has died
    int64_t control             # number of the control process
    int64_t beat                # ns, CLOCK_MONOTONIC at which the loop's newest round or tick began
    int64_t guard               # the same of the guardian's newest look; 0 without one
    int64_t live_count          # live parameters
    int64_t live_bytes          # of the JSON that describes them
    int64_t began               # ns, CLOCK_MONOTONIC of the run's begin; frames are timed from here
    int64_t wall                # ns, CLOCK_REALTIME of the run's begin
    int64_t first_tick          # ns from the run's begin to tick 0; rows are timed from there
    int64_t tick                # the last completed
    int64_t ticks               # how many completed
    int64_t missed              # grid points that were skipped
    int64_t dropped             # records that found the ring full
    int64_t frames_received
    int64_t frames_sent
    int64_t frames_foreign      # that no device took
    int64_t frames_malformed
    int64_t caught_up           # ticks that ran after the next grid point had come
    int64_t gil_taken           # how often the GIL was taken in ticks
    int64_t sleeps
    int64_t spins
    int64_t waited              # ns spent waiting for the recorder, in virtual time only
    Histogram lateness          # wake-up behind the grid point that was awaited
    Histogram period            # |period - T|
    Histogram execution         # of a tick
    Histogram gil               # waits for it
    Histogram bus               # receiving and sending
    uint64_t head               # bytes ever written; the producer's
    uint64_t spare[7]           # keeps the two ends on cache lines of their own
    uint64_t tail               # bytes ever read; the consumer's
    uint64_t more[7]
    Mailbox mailbox

cdef struct Shown:              # a live parameter, behind the ring; the JSON stands behind them all
    double value                # as the tick has it
    double target               # where it is going

cdef inline char *ring(PageLayout *page) noexcept nogil:
    return <char *>page + sizeof(PageLayout)

cdef inline Shown *shown(PageLayout *page) noexcept nogil:
    return <Shown *>(ring(page) + page.capacity)

cdef inline void *reserve(PageLayout *page, uint32_t kind, uint32_t size) noexcept nogil:
    """Room for one record, `size` a multiple of 8; NULL when the ring is full. Nothing is visible before `commit`."""
    cdef uint64_t head = page.head
    cdef uint64_t mask = page.capacity - 1
    cdef uint64_t free = page.capacity - (head - load_u64(&page.tail))
    cdef uint64_t to_end = page.capacity - (head & mask)
    cdef uint64_t need = sizeof(Header) + size
    cdef Header *header
    if need > to_end:                       # a record never wraps: pad to the end and start over
        if need + to_end > free:
            return NULL
        header = <Header *>(ring(page) + (head & mask))
        header.kind = PADDING
        header.bytes = <uint32_t>(to_end - sizeof(Header))
        head += to_end
        store_u64(&page.head, head)
    elif need > free:
        return NULL
    header = <Header *>(ring(page) + (head & mask))
    header.kind = kind
    header.bytes = size
    return <char *>header + sizeof(Header)

cdef inline void commit(PageLayout *page) noexcept nogil:
    cdef Header *header = <Header *>(ring(page) + (page.head & (page.capacity - 1)))
    store_u64(&page.head, page.head + sizeof(Header) + header.bytes)

cdef class Page:
    cdef PageLayout *layout
    cdef object memory
    cdef readonly int fd
    cdef uint64_t cursor            # bytes that `drain` has gone through; the ring's tail follows
    cdef bint made_here             # the file is ours to close
    cdef bint held                  # a thread of ours has the hold
    cdef bint guarding              # a thread of ours is the guardian's

    cpdef let_go(self)
