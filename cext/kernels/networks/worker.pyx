# cython: freethreading_compatible=True
"""Networks that run beside the loop, in a thread that only calls ONNX Runtime.

Jobs pass through a ring: the kernel submits the samples of a tick and takes the results `latency` ticks later. In
virtual time it waits for them. In real time it never waits: while a result is not ready, the last outputs hold, and the
tick counts as an overrun. A ring without space drops the samples; a streaming network then begins again.

    taken <= done <= submitted      counters of jobs; a slot is free again once its job is done and taken

Both sides sleep in the same way: the sleeper clears a word, looks once more for what it waits for, and sleeps while the
word is 0; the other stores what is waited for, and then sets the word. These are stores followed by loads of what the
other side stores, so all four are sequentially consistent. Otherwise the sleeper can miss the newest counter while the
other side misses the cleared word, and sleeps for up to LONG.
"""

import weakref

from libc.math cimport INFINITY
from libc.stdint cimport int32_t, int64_t, uint64_t, uintptr_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy, memset
from posix.types cimport pid_t
from posix.unistd cimport getpid

from cext.abi cimport ITEMS, OK, REAL_TIME, TICK, TIME, export, items, kernel_t
from cext.atomics cimport (
    load_i32, load_i32_in_order, load_u64, load_u64_in_order, store_i32, store_i32_in_order, store_u64,
    store_u64_in_order,
)
from cext.clock.deadline_clock cimport monotonic
from cext.clock.histogram cimport Histogram
from cext.kernels.networks.model cimport FAILED, IN_USE, NO_THREAD, STALE, Inference, Model, infer
from cext.kernels.networks.samples cimport NEEDED, Network, put_out, take_sample
from cext.posix cimport cpu_set_t, pthread_join, pthread_t, sched_getaffinity, sched_setaffinity
from cext.threads cimport be_called, doze, start_thread, wake

cdef size_t STACK = 1 << 20             # bytes
cdef int64_t LONG = 1000000000          # ns between looks for a request to end

cdef struct Job:
    int64_t tick
    double time                 # s
    bint restart                # its states are 0
    bint valid
    bint failed
    float *samples
    float *results

cdef struct Ring:
    Inference *model
    Job *jobs
    uint64_t capacity
    uint64_t submitted
    uint64_t done
    uint64_t taken
    uint64_t first              # earlier jobs are of an earlier start of the block
    int32_t work                # 0 while the thread has none
    int32_t result              # 0 while the kernel waits for one
    int32_t leave
    float *buffers              # of all jobs, then operands and results of the thread
    float *operands
    float *computed
    int64_t late                # ticks without the result that was due
    bint restarts               # the next job begins again
    double began                # s, first sample, or the first after steps that were left out for longer than `stale`
    double previous             # s, previous sample
    double newest               # s, samples of the present results; before `began` without any
    bint valid                  # the present results are
    double steps
    double samples              # since the states were 0
    pthread_t thread
    pid_t process               # in which the thread runs, 0 for none
    cpu_set_t processors

cdef struct Delayed:
    Network network
    int32_t ring                # address of the Ring
    int32_t delay               # ticks
    int32_t stale               # s
    int32_t stale_is_fault

DELAYED = items(
    (<Delayed *>ITEMS)[0], "plan[3] channel_scales[...] output_scales[...] operands[...] computed[...]")


cdef int delayed_kernel(double *arena, const Delayed *at, const Delayed *sizes) noexcept nogil:
    cdef Ring *ring = <Ring *><uintptr_t>arena[at.ring]
    cdef const Network *network = &at.network
    cdef float *results = <float *>(arena + network.computed)
    cdef int64_t due = <int64_t>arena[TICK] - <int64_t>arena[at.delay]
    cdef double age, share
    cdef Job *job
    if arena[network.count] == 0.0 and not restart(ring, arena[TIME]):
        return NO_THREAD
    if ring.process == 0:
        return NO_THREAD
    if arena[network.count] != ring.steps:
        return IN_USE
    if arena[TIME] - ring.previous > arena[at.stale]:   # as after its subsystem was disabled
        ring.began, ring.valid = arena[TIME], False
    ring.previous = arena[TIME]
    ring.steps += 1.0
    arena[network.count] = ring.steps
    take_sample(arena, network, <float *>(arena + network.operands))
    submit(ring, arena, network)
    if arena[REAL_TIME] == 0.0:
        wait_for(ring, due)
    while ring.taken < load_u64(&ring.done):
        job = &ring.jobs[ring.taken % ring.capacity]
        if job.tick > due:
            break
        if job.failed:
            return FAILED
        if job.time >= ring.began:
            memcpy(results, job.results, ring.model.result_size * sizeof(float))
            ring.newest, ring.valid = job.time, job.valid
        ring.taken += 1
    if ring.taken < ring.submitted and ring.jobs[ring.taken % ring.capacity].tick <= due:
        ring.late += 1
        arena[network.overruns] = ring.late
    age = arena[TIME] - max(ring.newest, ring.began)
    if age > arena[at.stale] and arena[at.stale_is_fault] != 0.0:
        return STALE
    share = 2.0 - age / arena[at.stale]
    arena[network.age] = age
    arena[network.valid] = ring.valid and age <= arena[at.stale]
    put_out(arena, network, results, 0.0 if not ring.valid else min(share, 1.0))
    return OK


cdef bint restart(Ring *ring, double now) noexcept nogil:
    """Begin with no results. Returns False if the thread cannot be started."""
    if ring.process != getpid():                    # never started, or this process is a fork, without the thread
        store_u64(&ring.done, ring.submitted)
        ring.process = getpid()
        if start_thread(&ring.thread, enter, ring, STACK) != 0:
            ring.process = 0
            return False
    ring.taken = ring.submitted
    store_u64(&ring.first, ring.submitted)
    ring.restarts, ring.valid, ring.steps, ring.samples = True, False, 0.0, 0.0
    ring.began, ring.previous, ring.newest, ring.late = now, now, -INFINITY, 0
    return True


cdef void submit(Ring *ring, double *arena, const Network *at) noexcept nogil:
    """Submit the present samples, or drop them if the ring is full."""
    cdef bint streams = ring.model.state_size > 0
    cdef Job *job = &ring.jobs[ring.submitted % ring.capacity]
    if ring.submitted - min(ring.taken, load_u64(&ring.done)) >= ring.capacity:
        ring.restarts = ring.restarts or streams
        ring.samples = 0.0 if streams else ring.samples + 1.0
        return
    ring.samples += 1.0
    job.tick, job.time, job.restart = <int64_t>arena[TICK], arena[TIME], ring.restarts
    job.valid = ring.samples >= arena[at.plan + NEEDED]
    memcpy(job.samples, arena + at.operands, ring.model.signal_size * sizeof(float))
    ring.restarts = False
    store_u64_in_order(&ring.submitted, ring.submitted + 1)     # before the load, as in the thread the other way round
    if load_i32_in_order(&ring.work) == 0:
        store_i32(&ring.work, 1)
        wake(&ring.work)


cdef void wait_for(Ring *ring, int64_t due) noexcept nogil:
    """Wait until all jobs up to a tick are done."""
    cdef uint64_t end = ring.taken
    while end < ring.submitted and ring.jobs[end % ring.capacity].tick <= due:
        end += 1
    while load_u64(&ring.done) < end:
        store_i32_in_order(&ring.result, 0)
        if load_u64_in_order(&ring.done) < end:
            doze(&ring.result, monotonic() + LONG)


cdef void *enter(void *context) noexcept nogil:
    cdef Ring *ring = <Ring *>context
    cdef Inference *model = ring.model
    cdef Job *job
    sched_setaffinity(0, sizeof(cpu_set_t), &ring.processors)       # the loop may be bound to one processor
    be_called("tickwork-net", 0)
    while not load_i32(&ring.leave):
        if ring.done == load_u64(&ring.submitted):
            store_i32_in_order(&ring.work, 0)
            if ring.done == load_u64_in_order(&ring.submitted) and not load_i32_in_order(&ring.leave):
                doze(&ring.work, monotonic() + LONG)
            continue
        job = &ring.jobs[ring.done % ring.capacity]
        if ring.done >= load_u64(&ring.first):
            if job.restart:
                memset(ring.operands + model.signal_size, 0, model.state_size * sizeof(float))
                memset(&model.times, 0, sizeof(Histogram))
            memcpy(ring.operands, job.samples, model.signal_size * sizeof(float))
            job.failed = infer(model, ring.operands, ring.computed) != 0
            memcpy(job.results, ring.computed, model.result_size * sizeof(float))
        store_u64_in_order(&ring.done, ring.done + 1)
        store_i32_in_order(&ring.result, 1)
        wake(&ring.result)
    return NULL


cdef void end_thread(Ring *ring) noexcept nogil:
    if ring.process == 0 or ring.process != getpid():
        return
    store_i32_in_order(&ring.leave, 1)              # before the word: the thread clears it and then looks here
    store_i32_in_order(&ring.work, 1)
    wake(&ring.work)
    pthread_join(ring.thread, NULL)
    ring.process = ring.leave = 0


cdef class Worker:
    """Thread of one network, started by its first step.

    model : Model whose tensors are arranged
    capacity : number of jobs that may wait
    """

    cdef Ring ring
    cdef readonly Model model

    def __init__(self, Model model, int capacity):
        cdef Ring *ring = &self.ring
        cdef size_t signal = model.inference.signal_size
        cdef size_t result = model.inference.result_size
        cdef uint64_t index
        operands, computed = model.sizes
        self.model = model
        ring.model, ring.capacity = &model.inference, capacity
        ring.jobs = <Job *>calloc(capacity, sizeof(Job))
        ring.buffers = <float *>calloc(capacity * (signal + result) + operands + computed, sizeof(float))
        if ring.jobs == NULL or ring.buffers == NULL:
            raise MemoryError
        for index in range(ring.capacity):
            ring.jobs[index].samples = ring.buffers + index * (signal + result)
            ring.jobs[index].results = ring.jobs[index].samples + signal
        ring.operands = ring.buffers + capacity * (signal + result)
        ring.computed = ring.operands + <size_t>operands
        sched_getaffinity(0, sizeof(cpu_set_t), &ring.processors)

    def __dealloc__(self):
        end_thread(&self.ring)
        free(self.ring.jobs); free(self.ring.buffers)

    @property
    def address(self) -> float:
        """Address of the Ring as a number, which is exact: addresses have 53 bits at most."""
        return float(<uintptr_t>&self.ring)

    @property
    def late(self) -> int:
        """Number of steps without the result that was due, since the last start of the block."""
        return self.ring.late

    def end(self) -> None:
        """End the thread after its present inference."""
        with nogil:
            end_thread(&self.ring)


class Owner:
    """Owner of a Worker, which ends with it, or before the interpreter does."""

    def __init__(self, worker):
        self.worker, self.model = worker, worker.model
        weakref.finalize(self, worker.end)


delayed = export(<kernel_t>delayed_kernel, DELAYED)
