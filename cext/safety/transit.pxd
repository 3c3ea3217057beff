"""Transit of a drive that answers every command: the time from a command to the arrival of its reply.

Principle
    1. Replies arrive in the order of their commands. A reply therefore answers the oldest command without a reply, and
       its sample is not older than that command: the age of a sample begins there, and contains the way of the command
       and the way of the reply. Commands count from the start of their tick.
    2. A lost frame leaves a command without a reply, and all later samples seem older by one command each; never
       younger. While no more commands are open than are certain to be on their way, every match is exact. With more,
       the sample is likely that of a later command, and no older than the one that it is matched with: the output `age`
       begins at the first, and the law of a drive is bounded from the second on.
    3. With more, either a frame was lost or replies have become later, which single replies do not show. Commands that
       are sent twice do: the tick in which two replies arrive gives the transit in ticks, and older commands were lost.
       PROOFS of them in a row must agree, with one reply in each tick between, and no longer transit must be known. If
       FAILURES attempts fail, the open commands are taken for late, and looked at again after TRANSIT_MEMORY. So they
       are where nothing was lost: on a bus that is nearly full, such commands would delay the replies further. A reply
       to a command that was dropped refutes what was concluded: then no transit is known for a time.
    4. The longest certain transit of the last one to two periods of TRANSIT_MEMORY is what the law of a drive allows
       for on the way of its next commands. Beyond `max_transit` and one period, stiffness and damping are zero.
All of it follows from the recorded frames and the times of ticks.
"""

from libc.stdint cimport int64_t

from cext.safety.thresholds cimport TRANSIT_MEMORY

cdef enum:
    OPEN = 64                           # commands without a reply that are kept; a power of two
    PROOFS = 3
    FAILURES = 6
    SPAN = 8                            # ticks, longest transit that is proved

cdef struct Transit:
    bint answers                        # whether the drive answers every command; else nothing here is used
    int64_t asked[OPEN]                 # ns, times of the commands without a reply
    int64_t ticks[OPEN]                 # in which they were sent
    int64_t sent[OPEN]                  # ns, when they were sent; of a run in real time later than `asked`
    int64_t first                       # index of the oldest
    int open                            # their number
    int64_t reference                   # ns, time of the oldest command that the newest sample may answer; -1: none
    int64_t likely                      # ns, time of the command that it answers if those before were lost
    int64_t newest                      # ns, transit of the newest reply, too long after lost frames
    int64_t silent_since                # ns, time of the first command after the newest reply; -1: none
    bint silent_early                   # whether replies to earlier commands were due then
    bint measured                       # there is a certain transit
    int64_t replies[OPEN]               # ns, from `sent` to the replies that are not certain
    int uncertain                       # their number
    int64_t pending                     # ns, longest of those that are not certain
    int64_t largest[2]                  # ns, longest certain one of the present and of the previous period
    int64_t emptied[2]                  # ns, longest one before no command was open, of the same periods
    int64_t turned                      # ns, start of the present period
    int64_t longest                     # ns, longest certain one of the run
    int settled                         # open commands that are certain to be on their way when a tick sends its own
    int came                            # replies since the previous tick
    int place                           # ticks since a command was sent twice; -1: none is observed
    int span                            # ticks for which it is observed
    int pause                           # ticks until the next command is sent twice
    int shift                           # ticks after which two replies arrived
    int proofs, failures
    int doubt                           # turns for which a reply without an open command refutes what was concluded
    bint retries                        # commands that are settled are looked at again
    bint rests                          # nothing was lost: no command is sent twice until the next period


cdef inline void forget_transit(Transit *t) noexcept nogil:
    """Return to the state before arming."""
    t.first = t.open = t.settled = t.came = t.proofs = t.failures = t.uncertain = t.pause = 0
    t.retries = t.rests = False
    t.doubt = 0
    t.reference = t.likely = t.silent_since = t.place = -1
    t.newest = t.pending = t.largest[0] = t.largest[1] = t.turned = t.longest = 0
    t.emptied[0] = t.emptied[1] = 0
    t.measured = False


cdef inline int64_t longest_transit(const Transit *t) noexcept nogil:
    return max(t.largest[0], t.largest[1])


cdef inline int64_t longest_possible(const Transit *t) noexcept nogil:
    """Return the longest transit that the replies so far allow, certain or not."""
    return max(t.newest, t.pending, longest_transit(t))


cdef inline void be_certain(Transit *t) noexcept nogil:
    """Note that all matches so far were exact."""
    t.largest[0], t.longest = max(t.largest[0], t.pending), max(t.longest, t.pending)
    t.pending = 0
    t.measured = True


cdef inline void measure_again(Transit *t) noexcept nogil:
    """Forget the transits of set-up, whose replies wait for each other."""
    if t.open == 0:
        t.largest[0] = t.largest[1] = t.emptied[0] = t.emptied[1] = t.longest = 0
        t.measured = False


cdef inline void drop_oldest(Transit *t) noexcept nogil:
    t.first = (t.first + 1) & (OPEN - 1)
    t.open -= 1


cdef inline void note_asked(Transit *t, int count, int64_t now, int64_t sent, int64_t tick) noexcept nogil:
    """Note that `count` frames that the drive answers are sent at `sent` in a tick that began at `now`, in ns."""
    cdef int index, place
    if not t.answers or count <= 0:
        return
    if t.silent_since < 0:
        t.silent_since, t.silent_early = now, t.open > 0
    for index in range(count):
        if t.open == OPEN:
            drop_oldest(t)
        place = <int>((t.first + t.open) & (OPEN - 1))
        t.asked[place], t.sent[place], t.ticks[place] = now, sent, tick
        t.open += 1


cdef inline void note_arrival(Transit *t, int64_t time) noexcept nogil:
    """Note a reply. time : ns, of its arrival. One without an open command is not older than the reply before."""
    t.silent_since = -1
    t.came += 1
    if not t.answers:
        return
    if t.open == 0:
        if t.doubt > 0:                 # a command that was taken for lost was late
            t.largest[0] = t.emptied[0] = TRANSIT_MEMORY
        return
    t.reference = t.asked[t.first]
    t.newest = max(time - t.reference, 0)
    t.pending = max(t.pending, t.newest)
    t.replies[t.uncertain] = max(time - t.sent[t.first], 0)
    t.uncertain += t.uncertain < OPEN - 1
    drop_oldest(t)
    t.likely = t.reference
    if t.open > t.settled:
        t.likely = t.asked[(t.first + t.open - t.settled - 1) & (OPEN - 1)]
    if t.open == 0:
        t.emptied[0] = max(t.emptied[0], t.pending)
    if t.open <= t.settled or t.open == 0:
        be_certain(t)


cdef inline void turn_memory(Transit *t, int64_t now) noexcept nogil:
    if now - t.turned >= TRANSIT_MEMORY:
        t.largest[1], t.largest[0], t.turned = t.largest[0], 0, now
        t.emptied[1], t.emptied[0] = t.emptied[0], 0
        t.retries = True
        t.rests = False
        t.doubt -= t.doubt > 0


cdef inline bint is_doubtful(const Transit *t) noexcept nogil:
    """Return whether replies may be later than was measured, and nothing shows it for now."""
    return t.rests and t.open > t.settled


cdef inline bint watch_transit(
        Transit *t, int64_t tick, int64_t period, bint may_repeat, bint stiff) noexcept nogil:
    """Decide, before the commands of a tick, on open commands. Returns whether the command is to be sent twice.

    period : ns
    may_repeat : whether it can be, and is a single frame
    stiff : whether stiffness or damping depends on it; otherwise once in TRANSIT_MEMORY is enough
    """
    cdef int came = t.came
    t.came = 0
    if not t.answers:
        return False
    if t.open == 0:
        t.settled = 0                   # the last reply has been received
        t.retries = False
    if not may_repeat or t.open <= (0 if t.retries else t.settled) or not (t.retries or (stiff and not t.rests)):
        t.place = -1
        t.proofs = t.failures = t.pause = 0
        return False
    if t.place >= 0:
        return observe(t, tick, period, came)
    if came != 1 and t.pause > 0:
        return reject(t)
    t.pause -= t.pause > 0
    if t.pause > 0 or came == 0:
        return False
    t.place = 0
    t.span = min(t.open, SPAN)
    return True


cdef inline bint observe(Transit *t, int64_t tick, int64_t period, int came) noexcept nogil:
    """Look for the replies to a command that was sent twice. Returns False."""
    if not 1 <= came <= 2 or (came == 2 and t.proofs > 0 and t.place != t.shift):
        return reject(t)
    if came == 2:
        t.shift = t.place
        t.proofs += 1
        t.place, t.pause = -1, t.proofs     # not at equal intervals, which an equal transit would imitate
        if max(t.emptied[0], t.emptied[1]) >= (t.shift + 1) * period:
            return reject(t)                # a longer transit has occurred: such replies show nothing
        if t.proofs == PROOFS:
            conclude(t, tick)
        return False
    if t.place >= (t.shift if t.proofs > 0 else t.span):
        return reject(t)
    t.place += 1
    return False


cdef inline bint reject(Transit *t) noexcept nogil:
    """End an attempt that shows nothing."""
    t.place = -1
    t.proofs = t.pause = 0
    t.failures += 1
    if t.failures >= FAILURES:
        t.failures, t.retries, t.rests = 0, False, True
        t.settled = t.open
        be_certain(t)
    return False


cdef inline void conclude(Transit *t, int64_t tick) noexcept nogil:
    """Drop the commands that are older than the transit, which is `shift` ticks."""
    cdef int open = t.open
    while t.open > 0 and t.ticks[t.first] < tick - t.shift:
        drop_oldest(t)
    if t.open < open:
        t.pending = t.uncertain = 0
        t.doubt = 2
    t.rests = t.open == open
    t.settled = t.open
    t.proofs = t.failures = t.pause = 0
    t.retries = False
    if t.open > 0:
        be_certain(t)
