# cython: freethreading_compatible=True
"""Keys of the run's terminal. A native thread of the control process reads them, so that a stop waits for no other process.

    read      each byte as it arrives, in single-key mode and without echo, while the run is in the foreground
    stop      at a space anywhere in what was read, or q at a question: in the shared state, at once
    pass on   every byte to the recorder, with the time after which it was pressed and the question asked before; a byte
              that may have waited in the terminal's queue since before a question does not answer it
    report    on the terminal, if the recorder does not take the keys

Ctrl-C remains the terminal's: it becomes SIGINT as soon as it arrives, as long as the queue before it is read.

The thread never takes the GIL, and has file descriptors of its own, so that a block that closes those of the process
does not end it. It restores the terminal only if its mode is still the one that was set here, so that it never overwrites
the settings of another process.
"""

from libc.errno cimport EAGAIN, errno
from libc.stdint cimport int32_t, int64_t, uint8_t, uint32_t, uint64_t
from libc.string cimport memset
from posix.unistd cimport getpgrp, read, tcgetpgrp, write

import os

from cext.atomics cimport load_i32, load_u64, store_i32
from cext.clock.deadline_clock cimport monotonic
from cext.posix cimport (
    CPU_COUNT, CPU_SET, CPU_ZERO, POLLIN, SCHED_FIFO, SCHED_RESET_ON_FORK, cpu_set_t, poll, pollfd, pthread_join,
    pthread_t, sched_getparam, sched_getscheduler, sched_param, sched_setaffinity,
)
from cext.ring.keys cimport KEYS, Key, get_key, put_key
from cext.ring.mailbox cimport BY_KEYS
from cext.ring.operator cimport ask_to_stop
from cext.memory.shared_state cimport READY, RUNNING, WAITING, SharedLayout, SharedState
from cext.safety.thresholds cimport KEYS_UNTAKEN_LIMIT
from cext.threads cimport be_called, doze, start_thread, wake

cdef extern from *:
    """
    #include <string.h>
    #include <sys/syscall.h>
    #include <termios.h>
    #include <unistd.h>

    static inline void tw_key_mode(struct termios *mode) {
        mode->c_lflag &= ~(ICANON | ECHO);
        mode->c_cc[VMIN] = 1;
        mode->c_cc[VTIME] = 0;
    }
    static inline int tw_same_mode(const struct termios *one, const struct termios *other) {
        return one->c_iflag == other->c_iflag && one->c_oflag == other->c_oflag && one->c_cflag == other->c_cflag
            && one->c_lflag == other->c_lflag && !memcmp(one->c_cc, other->c_cc, sizeof(one->c_cc));
    }
    static inline void tw_keep_only(int file) {
    #if defined(SYS_close_range)
        if (syscall(SYS_close_range, file + 1, ~0U, 2 /* CLOSE_RANGE_UNSHARE */) == 0 && file > 0)
            syscall(SYS_close_range, 0, file - 1, 0);
    #else
        (void)file;
    #endif
    }
    """
    ctypedef struct termios_t "struct termios":
        pass
    int tcgetattr(int file, termios_t *mode) noexcept nogil
    int tcsetattr(int file, int actions, const termios_t *mode) noexcept nogil
    int tcflush(int file, int queue) noexcept nogil
    const int TCSANOW
    const int TCIFLUSH
    void key_mode "tw_key_mode"(termios_t *mode) noexcept nogil
    bint same_mode "tw_same_mode"(const termios_t *one, const termios_t *other) noexcept nogil
    # Give the calling thread a table of file descriptors of its own with this one alone; from Linux 5.9 on.
    void keep_only "tw_keep_only"(int file) noexcept nogil

cdef size_t STACK = 64 << 10            # bytes
cdef enum:
    BYTES = 256                         # bytes of a read
    START_LIMIT = 1_000_000_000         # ns, for the thread to read what was typed before
    FOLLOW_PERIOD = 100_000_000         # ns between two looks at the process group in the foreground
    LOOK_PERIOD = 10                    # ms between two looks for a key
    LOOK_PERIOD_ASKING = 1              # ms, outside of a running robot
    SPACE = 0x20
    QUIT = 0x71                         # q

cdef bytes TEXT = (b"\r\x1b[Ktickwork: the recorder does not take the keys. "
    b"The space bar still stops the run, and so does Ctrl-C\n")
cdef const char *UNTAKEN = TEXT
cdef size_t UNTAKEN_BYTES = len(TEXT)


cdef void *enter(void *context) noexcept nogil:
    (<KeyReader>context).watch()
    return NULL


cdef class KeyReader:
    """Thread that reads the keys of a terminal until `stop`.

    shared : SharedState
    file : descriptor of the terminal, which does not block
    processors : processors of the thread; those of the calling thread if empty

    Starts at once, with a priority one above that of the calling thread if that is real-time. A space that was typed
    before has then requested the stop. Raises OSError.
    """

    cdef SharedState shared
    cdef SharedLayout *layout
    cdef int file
    cdef int priority                   # priority of SCHED_FIFO, 0 for an ordinary thread
    cdef cpu_set_t processors
    cdef pthread_t thread
    cdef int32_t begun, leave
    cdef bint running
    cdef bint entered                   # whether key mode was set here
    cdef termios_t before               # mode to restore
    cdef int64_t since, follow_at
    cdef uint32_t question
    cdef bint reported

    def __init__(self, SharedState shared, int file, processors=()):
        cdef sched_param parameters
        cdef int64_t until
        cdef int failed
        CPU_ZERO(&self.processors)
        for number in processors:
            CPU_SET(number, &self.processors)
        self.shared, self.layout, self.file = shared, shared.layout, file
        if sched_getscheduler(0) & ~SCHED_RESET_ON_FORK == SCHED_FIFO and sched_getparam(0, &parameters) == 0:
            self.priority = parameters.sched_priority + 1
        self.since = monotonic()
        failed = start_thread(&self.thread, enter, <void *>self, STACK)
        if failed:
            raise OSError(failed, "cannot start the thread that reads the keys: %s" % os.strerror(failed))
        self.running = True
        until = monotonic() + START_LIMIT
        with nogil:
            while not load_i32(&self.begun) and monotonic() < until:        # a signal ends a doze
                doze(&self.begun, until)

    def stop(self) -> None:
        """End the thread, and restore the terminal."""
        if not self.running:
            return
        self.running = False
        store_i32(&self.leave, 1)
        wake(&self.leave)
        with nogil:
            pthread_join(self.thread, NULL)

    def __dealloc__(self):
        self.stop()

    cdef void watch(self) noexcept nogil:
        cdef int64_t now
        if CPU_COUNT(&self.processors):
            sched_setaffinity(0, sizeof(cpu_set_t), &self.processors)
        be_called("tickwork-keys", self.priority)
        keep_only(self.file)
        if self.is_in_foreground():
            self.enter_key_mode()
            self.read_early()
        store_i32(&self.begun, 1)
        wake(&self.begun)
        while not load_i32(&self.leave):
            now = monotonic()
            if now >= self.follow_at:
                self.follow_at = now + FOLLOW_PERIOD
                self.follow()
            self.report_untaken(now)
            if self.layout.keys.listening:
                self.look()
            else:
                doze(&self.leave, self.follow_at)
        self.leave_key_mode()

    cdef bint is_in_foreground(self) noexcept nogil:
        return tcgetpgrp(self.file) == getpgrp()

    cdef void follow(self) noexcept nogil:
        """Enter key mode when the run comes to the foreground, leave it when the run leaves the foreground."""
        cdef bint listened = self.layout.keys.listening
        if not self.is_in_foreground():
            self.leave_key_mode()
            return
        self.enter_key_mode()
        if not listened and self.layout.keys.listening:
            tcflush(self.file, TCIFLUSH)                    # typed for another program

    cdef void enter_key_mode(self) noexcept nogil:
        """Set key mode, unless it is set; a shell may have restored another."""
        cdef termios_t now, ours
        if tcgetattr(self.file, &now) != 0:                 # the terminal is closed
            store_i32(&self.layout.keys.listening, 0)
            return
        if self.entered:
            ours = self.before
            key_mode(&ours)
        if not self.entered or not same_mode(&now, &ours):
            self.before, self.entered = now, True
            key_mode(&now)
            tcsetattr(self.file, TCSANOW, &now)
        store_i32(&self.layout.keys.listening, 1)

    cdef void leave_key_mode(self) noexcept nogil:
        cdef termios_t now, ours
        store_i32(&self.layout.keys.listening, 0)
        if not self.entered:
            return
        self.entered = False
        ours = self.before
        key_mode(&ours)
        if tcgetattr(self.file, &now) == 0 and same_mode(&now, &ours):
            tcsetattr(self.file, TCSANOW, &self.before)

    cdef void read_early(self) noexcept nogil:
        """Read what was typed while the run was starting: only a stop counts."""
        cdef uint8_t[BYTES] typed
        cdef ssize_t count = read(self.file, typed, BYTES)
        while count > 0:
            self.look_for_stop(typed, count)
            count = read(self.file, typed, BYTES)

    cdef void look(self) noexcept nogil:
        """Wait for keys, for a look period at most, and pass them on."""
        cdef uint8_t[BYTES] typed
        cdef pollfd file
        cdef Key key
        cdef ssize_t count, index
        cdef int64_t now = monotonic()
        cdef uint32_t question = <uint32_t>load_u64(&self.layout.operator.question)
        file.fd, file.events, file.revents = self.file, POLLIN, 0
        if poll(&file, 1, 0) == 0:                          # the queue is empty: later keys are newer than `now`
            self.since, self.question = now, question
            poll(&file, 1, LOOK_PERIOD if load_i32(&self.layout.state) == RUNNING else LOOK_PERIOD_ASKING)
        if file.revents == 0:
            return
        count = read(self.file, typed, BYTES) if file.revents & POLLIN else 0
        if count <= 0:
            if count == 0 or errno != EAGAIN:               # closed, or in the background: `follow` decides
                store_i32(&self.layout.keys.listening, 0)
            return
        self.look_for_stop(typed, count)
        memset(&key, 0, sizeof(Key))
        key.since, key.question, key.read = self.since, self.question, monotonic()
        for index in range(count):
            key.byte = typed[index]
            put_key(&self.layout.keys, &key)

    cdef void look_for_stop(self, const uint8_t *typed, ssize_t count) noexcept nogil:
        """Stop the run at a space anywhere in what was typed, or q while the run waits for the operator."""
        cdef int32_t state = load_i32(&self.layout.state)
        cdef ssize_t index
        for index in range(count):
            if typed[index] == SPACE or (typed[index] == QUIT and (state == READY or state == WAITING)):
                ask_to_stop(&self.layout.operator, BY_KEYS, <uint64_t>self.layout.control)

    cdef void report_untaken(self, int64_t now) noexcept nogil:
        """Report once that the recorder does not take the keys."""
        cdef uint64_t tail = load_u64(&self.layout.keys.tail)
        if tail == self.layout.keys.head:
            self.reported = False
        elif not self.reported and now - self.layout.keys.keys[tail % KEYS].read > KEYS_UNTAKEN_LIMIT:
            self.reported = True
            write(self.file, UNTAKEN, UNTAKEN_BYTES)


cdef class KeyQueue:
    """The recorder's end: keys that the control process has read. shared : SharedState"""

    cdef SharedState shared

    def __init__(self, SharedState shared):
        self.shared = shared

    def take(self) -> list[tuple[int, int, int, int]]:
        """Return the bytes since the last call: (byte, ns after which it was pressed, ns when it was read, number of the
        newest question before), with times of CLOCK_MONOTONIC.
        """
        cdef Key key
        taken = []
        while len(taken) < KEYS and get_key(&self.shared.layout.keys, &key):
            taken.append((key.byte & 0xFF, key.since, key.read, key.question))
        return taken

    @property
    def listening(self) -> bool:
        """Whether the control process reads the terminal: the run is in the foreground."""
        return load_i32(&self.shared.layout.keys.listening) != 0
