# cython: freethreading_compatible=True
"""Loop side of the mailbox: live parameters, and the progress of each change.

A change takes effect at the start of a tick, or not at all: it is checked against bounds in private memory, and waits
if the ring cannot record it. A parameter with a slew approaches its new value by at most slew · dt per tick. Rules
between parameters hold for the targets of a request together, and for the values of each tick (live_rules.pyx).
"""

from cpython.object cimport PyObject
from libc.math cimport INFINITY, floor
from libc.stdint cimport uint32_t, uintptr_t
from libc.stdlib cimport calloc, free

from cext.abi cimport OK
from cext.status cimport PYTHON_ERROR
from cext.atomics cimport store_u64
from cext.ring.mailbox cimport (
    AGAINST_RULE, BY_REPLAY, CHANGES, LETTERS, MARK, OUT_OF_BOUNDS, OVER, SET, STOP, TAKEN, UNKNOWN, Change, answer,
    take_oldest,
)
from cext.ring.operator cimport origin_of_stop, process_of_stop
from cext.clock.histogram cimport add
from cext.memory.shared_state cimport CHANGE, commit, reserve, shown
from cext.clock.stopwatch cimport GIL_WAIT, lap
from cext.schedule.held_outputs cimport HeldOutputs
from cext.schedule.live_rules cimport LiveParameter, LiveRules, approach

cdef int64_t NEVER = 0x7FFFFFFFFFFFFFFF

TYPES = {"float": float, "int": int, "bool": bool}


cdef class LiveTable:
    """Live parameters of a schedule.

    entries : graph.schedule.LiveParameter of each, in the order of their indices in letters
    rules : cext.rules.LiveRule of each rule between them
    held_bounds : graph.schedule.HeldBound of what blocks keep while they do not run
    arena : the float64 array of the program
    """

    def __init__(self, entries, rules, held_bounds, arena):
        cdef LiveParameter *parameter
        self.entries = list(entries)
        self.count = len(self.entries)
        self.rules = LiveRules(rules, self.count)
        self.held = HeldOutputs(held_bounds)
        groups = self.rules.groups()
        self.arena = <double *><uintptr_t>arena.ctypes.data
        self.parameters = <LiveParameter *>calloc(max(1, self.count), sizeof(LiveParameter))
        for index, entry in enumerate(self.entries):
            parameter = &self.parameters[index]
            parameter.slot = entry.slot
            parameter.low, parameter.high, parameter.built = entry.low, entry.high, entry.built
            parameter.whole = entry.dtype != "float"
            parameter.built_slew = INFINITY if parameter.whole else entry.slew
            parameter.block = <PyObject *>entry.block if entry.block is not None else NULL
            parameter.group = groups[index]
        self.reset()

    def __dealloc__(self):
        free(self.parameters)
        free(self.script)

    def follow(self, changes) -> None:
        """Apply these changes in every run from now on, in addition to the mailbox.

        changes : (tick, index of the parameter, value, slew), in the order of ticks; each sets the slew of the
            parameter from then on, as in the recorded run. Raises ValueError for one that the table does not allow
        """
        free(self.script)
        self.scripted = len(changes)
        self.script = <Scripted *>calloc(max(1, self.scripted), sizeof(Scripted))
        targets = [entry.built for entry in self.entries]
        for position, (tick, index, value, slew) in enumerate(changes):
            self.script[position].tick, self.script[position].parameter = tick, index
            self.script[position].value = value
            self.script[position].slew = slew
            self.place(targets, index, value)
            if position + 1 == self.scripted or changes[position + 1][0] != tick:
                self.rules.check(targets)       # changes of one tick may be of one request

    def assign(self, changes) -> list[float]:
        """Set the targets of parameters between two ticks; they then change at their slews. Returns the present values.

        changes : (index of the parameter, value), all or none. Raises ValueError for those that the table does not
        allow
        """
        targets = [self.parameters[index].target for index in range(self.count)]
        for index, value in changes:
            self.place(targets, index, value)
        self.rules.check(targets)
        for index, value in changes:
            self.parameters[<int>index].target = value
        self.moving = self.count                # `advance` counts again
        return [self.parameters[<int>index].value for index, _ in changes]

    cdef object place(self, list targets, int index, double value):
        """Set the target of a parameter in a list. Raises ValueError for one outside its type and bounds."""
        cdef Letter letter
        letter.kind, letter.count, letter.parameters[0], letter.values[0] = SET, 1, index, value
        if self.check_values(&letter) != TAKEN:
            raise ValueError("live parameter %d rejects the value %r" % (index, value))
        targets[index] = value

    def reset(self) -> None:
        """Restore every parameter to its built value. Native ones are reset with the arena."""
        cdef int index
        cdef LiveParameter *parameter
        self.moving = 0
        self.marks = 0
        self.gil_taken = 0
        self.played = 0
        self.due = self.script[0].tick if self.scripted else NEVER
        self.seen = <uint64_t>-1                # check waiting letters in the first tick
        self.error = self.culprit = None
        for index in range(self.count):
            parameter = &self.parameters[index]
            parameter.value = parameter.target = parameter.built
            parameter.slew = parameter.built_slew
            parameter.changed = parameter.block != NULL
        if self.update_python(NULL) != OK:
            raise self.error

    def leave(self) -> None:
        """Restore the blocks of the diagram after a run. The arena and the shared state keep the final values."""
        for entry in self.entries:
            if entry.block is not None:
                setattr(entry.block, entry.name, TYPES[entry.dtype](entry.built))

    cdef void forgive(self):
        """Clear the exception of setting an attribute."""
        self.error = self.culprit = None

    cdef void assume(self, int slot, double value) noexcept nogil:
        """Set a parameter from within the loop. slot : its slot in the arena"""
        cdef int index
        for index in range(self.count):
            if self.parameters[index].slot == slot:
                self.parameters[index].value = self.parameters[index].target = value
        self.arena[slot] = value

    cdef void show(self, SharedLayout *layout) noexcept nogil:
        """Write the values to the shared state."""
        cdef int index
        if layout == NULL or layout.live_count != self.count:
            return
        for index in range(self.count):
            shown(layout)[index].value = self.parameters[index].value
            shown(layout)[index].target = self.parameters[index].target

    cdef void dismiss(self, SharedLayout *layout) noexcept nogil:
        """Answer the waiting letters: the run has ended."""
        cdef Letter *letter
        cdef Letter copy
        cdef int rounds
        if layout == NULL:
            return
        for rounds in range(LETTERS):
            letter = take_oldest(&layout.mailbox, &copy)
            if letter == NULL:
                return
            answer(letter, &copy, OVER, -1, 0)

    cdef int work(self, SharedLayout *layout, int64_t tick, double dt) noexcept nogil:
        cdef int status = OK
        cdef uint64_t stop
        if layout != NULL:
            stop = load_u64(&layout.operator.stop)
            if stop != 0:
                record_request(layout, STOP, origin_of_stop(stop), process_of_stop(stop), tick)
                return STOP_WANTED
            if tick >= self.due:
                self.play(layout, tick)
            if tick >= 0 and load_u64(&layout.mailbox.posted) != self.seen:
                self.take(layout, tick)
        if status == OK and self.moving:
            status = self.advance(dt)
            self.show(layout)
        return status

    cdef void play(self, SharedLayout *layout, int64_t tick) noexcept nogil:
        """Carry out the changes of the script for this tick."""
        cdef Letter letter
        letter.kind, letter.origin, letter.writer, letter.count = SET, BY_REPLAY, 0, 1
        while self.played < self.scripted and self.script[self.played].tick <= tick:
            letter.parameters[0], letter.values[0] = self.script[self.played].parameter, self.script[self.played].value
            self.parameters[letter.parameters[0]].slew = self.script[self.played].slew
            if not self.carry_out(layout, &letter, tick):
                break                           # the ring is full: try again in the next tick
            self.played += 1
        self.due = self.script[self.played].tick if self.played < self.scripted else NEVER

    cdef void take(self, SharedLayout *layout, int64_t tick) noexcept nogil:
        """Carry out waiting letters, in the order of posting.

        Letters that arrive meanwhile may wait for the next tick.
        """
        cdef uint64_t posted = load_u64(&layout.mailbox.posted)
        cdef Letter *letter
        cdef Letter copy                        # a defective writer cannot change what has been checked
        cdef int rounds, verdict
        for rounds in range(LETTERS):
            letter = take_oldest(&layout.mailbox, &copy)
            if letter == NULL:
                self.seen = posted
                return
            verdict = self.check(&copy)
            if verdict == TAKEN and not self.carry_out(layout, &copy, tick):
                store_u64(&letter.state, copy.state)            # it waits for space in the ring
                return
            answer(letter, &copy, verdict, tick, self.marks)

    cdef int check(self, const Letter *letter) noexcept nogil:
        cdef int verdict
        if letter.kind == MARK:
            return TAKEN
        if letter.kind != SET or not 0 < letter.count <= CHANGES:
            return UNKNOWN
        verdict = self.check_values(letter)
        if verdict == TAKEN and not self.rules.allow(self.parameters, letter):
            verdict = AGAINST_RULE
        return verdict

    cdef int check_values(self, const Letter *letter) noexcept nogil:
        cdef int index, which
        cdef double value
        cdef LiveParameter *parameter
        for index in range(letter.count):
            which, value = letter.parameters[index], letter.values[index]
            if not 0 <= which < self.count:
                return UNKNOWN
            parameter = &self.parameters[which]
            # NaN fails
            if not parameter.low <= value <= parameter.high or parameter.whole and floor(value) != value:
                return OUT_OF_BOUNDS
        return TAKEN

    cdef bint carry_out(self, SharedLayout *layout, const Letter *letter, int64_t tick) noexcept nogil:
        """Set targets and record them. Returns False, with nothing done, if the ring is full."""
        cdef int count = letter.count if letter.kind == SET else 1
        cdef int index
        cdef LiveParameter *parameter
        cdef Change *change = <Change *>reserve(layout, CHANGE, <uint32_t>(count * sizeof(Change)))
        if change == NULL:
            return False
        for index in range(count):
            change.tick, change.kind = tick, letter.kind
            change.origin, change.writer = letter.origin, letter.writer
            change.parameter, change.value, change.before, change.slew = -1, 0.0, 0.0, 0.0
            if letter.kind == MARK:
                self.marks += 1
                change.value = <double>self.marks
            elif letter.kind == SET:
                parameter = &self.parameters[letter.parameters[index]]
                change.parameter, change.value = letter.parameters[index], letter.values[index]
                change.before, change.slew = parameter.value, parameter.slew
                parameter.target = letter.values[index]
            change += 1
        commit(layout)
        if letter.kind == SET:
            self.moving = self.count            # `advance` counts again
        return True

    cdef int advance(self, double dt) noexcept nogil:
        """Move every parameter towards its target, by dt s."""
        cdef int index
        cdef bint python = False
        cdef LiveParameter *parameter
        self.moving = 0
        for index in range(self.count):
            parameter = &self.parameters[index]
            parameter.before = parameter.value
            parameter.value = approach(parameter.value, parameter.target, parameter.slew * dt)
        if self.rules.count > 0:
            self.rules.keep(self.parameters, dt)
        for index in range(self.count):
            parameter = &self.parameters[index]
            self.moving += parameter.value != parameter.target
            if parameter.value == parameter.before:
                continue
            if parameter.slot >= 0:
                self.arena[parameter.slot] = parameter.value
            if parameter.block != NULL:
                parameter.changed = python = True
        self.held.clip(self.arena, self.parameters)
        if not python:
            return OK
        self.gil_taken += 1
        return self.update_python(self.laps)

    cdef int update_python(self, Laps *laps) noexcept nogil:
        """Set the attributes of Python blocks that have changed. laps : for the wait for the GIL, or NULL"""
        cdef int index
        cdef int64_t waited
        cdef LiveParameter *parameter
        with gil:
            if laps != NULL:
                waited = lap(laps, GIL_WAIT)
                if laps.waits != NULL:
                    add(laps.waits, waited, laps.tick)
            for index in range(self.count):
                parameter = &self.parameters[index]
                if not parameter.changed:
                    continue
                parameter.changed = False
                entry = self.entries[index]
                try:
                    setattr(<object>parameter.block, entry.name, TYPES[entry.dtype](parameter.value))
                except BaseException as error:
                    self.error, self.culprit = error, entry.block.path
                    return PYTHON_ERROR
        return OK


cdef void record_request(SharedLayout *layout, int32_t kind, int32_t origin, uint64_t process, int64_t tick) noexcept nogil:
    """Record a request from outside the mailbox. process : its ID. Requires a layout."""
    cdef Change *change = <Change *>reserve(layout, CHANGE, sizeof(Change))
    if change == NULL:
        layout.dropped += 1
        return
    change.tick, change.kind, change.origin, change.writer = tick, kind, origin, <int32_t>process
    change.parameter, change.value, change.before, change.slew = -1, 0.0, 0.0, 0.0
    commit(layout)
