# cython: freethreading_compatible=True
"""Time of the parts of a tick, from clock readings between them.

In real time, the clock is read before and after each Python step and each sequence of native steps, and between phases:
enough to name the item that made a tick too long. With a profile, it is read after every step, with a histogram for
each.
"""

cimport cython
from libc.stdlib cimport calloc, free
from libc.string cimport memset


MACHINE = "the machine, which woke the loop late"
PHASES = {
    WOKEN_LATE: MACHINE, RECEIVE: "receiving", COMMAND: "encoding", TRANSMIT: "sending",
    GIL_WAIT: "waiting for the GIL", PLANT: "the plant", RECORD: "recording",
}


def names(schedule) -> list[str]:
    """Return the name of each item: text for a phase, the path of a step's block, the path of a device."""
    return [*(PHASES[item] for item in range(FIRST_STEP)),
        *(step.name for step in (*schedule.output, *schedule.update, *schedule.devices))]


def python_steps(schedule) -> bytes:
    """Return whether each item is a step in Python, as a byte."""
    flags = [step.kernel is None for step in (*schedule.output, *schedule.update)]
    return bytes(FIRST_STEP) + bytes(flags) + bytes(len(schedule.devices))


def time_of_lap(int64_t laps=20000) -> float:
    """Return the time of one clock reading with its histogram, in s."""
    cdef Histogram histogram
    cdef Laps watch
    cdef int64_t index
    memset(&histogram, 0, sizeof(Histogram))
    memset(&watch, 0, sizeof(Laps))
    watch.each = &histogram
    watch.last = began = monotonic()
    for index in range(laps):
        lap(&watch, 0)
    return (watch.last - began) * 1e-9 / laps


@cython.final
cdef class Stopwatch:
    """Stopwatch of a schedule. profile : whether every step is timed"""

    def __init__(self, schedule, bint profile):
        self.schedule = schedule
        self.steps = [*schedule.output, *schedule.update]
        self.count = FIRST_STEP + len(self.steps) + len(schedule.devices)
        self.blamed = <Blamed *>calloc(self.count, sizeof(Blamed))
        if profile:
            self.laps.each = <Histogram *>calloc(self.count, sizeof(Histogram))

    def __dealloc__(self):
        free(self.blamed); free(self.laps.each)

    cdef void reset(self):
        memset(self.blamed, 0, self.count * sizeof(Blamed))
        if self.laps.each != NULL:
            memset(self.laps.each, 0, self.count * sizeof(Histogram))

    cdef void begin(self, int64_t tick, int64_t now) noexcept nogil:
        self.laps.tick, self.laps.last, self.laps.longest, self.laps.item = tick, now, 0, WOKEN_LATE

    cdef void blame(self, int item, int64_t ns, int64_t missed) noexcept nogil:
        """Count `missed` grid points against `item`, which took `ns` in the tick of the last `begin`."""
        cdef Blamed *blamed = &self.blamed[item]
        blamed.times += 1
        blamed.missed += missed
        if ns > blamed.longest:
            blamed.longest, blamed.at = ns, self.laps.tick

    def name(self, int item) -> str:
        """Return the path of a block or device, 'left/a to left/b' for a sequence of native blocks, or text for a
        phase.
        """
        cdef int first = item - FIRST_STEP
        cdef int last = first
        if first < 0:
            return PHASES[item]
        if first >= len(self.steps):
            return self.schedule.devices[first - len(self.steps)].name
        step = self.steps[first]
        end = len(self.schedule.output) if first < len(self.schedule.output) else len(self.steps)
        if self.laps.each == NULL and step.kernel is not None:
            while last + 1 < end and self.follows(self.steps[last + 1], step):
                last += 1
        return step.name if self.steps[last].name == step.name else "%s to %s" % (step.name, self.steps[last].name)

    def follows(self, step, first) -> bool:
        """Return whether a native step is in the sequence that begins with `first`."""
        return step.kernel is not None and (step.every, step.conditions) == (first.every, first.conditions)

    def kind(self, int item) -> str:
        """Return "phase", "native", "Python", "device", or "native update" and "Python update"."""
        cdef int step = item - FIRST_STEP
        if step < 0:
            return "phase"
        if step >= len(self.steps):
            return "device"
        return ("native" if self.steps[step].kernel is not None else "Python") + (" update"
            if step >= len(self.schedule.output) else "")

    def overruns(self) -> list[dict[str, Any]]:
        """Return the items that caused missed grid points, most first: dicts of name, times, missed, longest (s),
        at_tick.
        """
        found = [
            {"name": self.name(item), "times": self.blamed[item].times, "missed": self.blamed[item].missed,
             "longest": self.blamed[item].longest * 1e-9, "at_tick": self.blamed[item].at}
            for item in range(self.count) if self.blamed[item].times
        ]
        return sorted(found, key=lambda row: -row["missed"])

    def rows(self) -> list[dict[str, Any]]:
        """Return the profile, longest total first: dicts of name, kind, and the histogram's summary.

        Empty without a profile.
        """
        if self.laps.each == NULL:
            return []
        found = [
            {"name": self.name(item), "kind": self.kind(item), **summary(&self.laps.each[item])}
            for item in range(self.count) if self.laps.each[item].count
        ]
        return sorted(found, key=lambda row: -row["total"])
