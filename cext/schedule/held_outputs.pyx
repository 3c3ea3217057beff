# cython: freethreading_compatible=True
"""Outputs that a block keeps while it does not run, and the live parameters that bound them.

A block of a disabled or a slow subsystem, or one whose exceptions are held, keeps its outputs. A limit that is lowered
in the meantime bounds them at the start of the same tick. They move towards 0, never away from it: a raised limit raises
nothing, and outputs that are 0 until the block first runs stay 0.
"""

from libc.math cimport fmax, fmin
from libc.stdlib cimport calloc, free

from cext.schedule.live_rules cimport LiveParameter, Term


cdef class HeldOutputs:
    """Bounds of a schedule. entries : graph.schedule.HeldBound of each"""

    def __init__(self, entries):
        cdef HeldBound *bound
        cdef int place = 0
        self.count = len(entries)
        self.bounds = <HeldBound *>calloc(max(1, self.count), sizeof(HeldBound))
        self.terms = <Term *>calloc(1 + sum(len(each.low.terms) + len(each.high.terms) for each in entries), sizeof(Term))
        for index, entry in enumerate(entries):
            bound = &self.bounds[index]
            bound.slot, bound.size = entry.slot, entry.size
            bound.low, bound.high = entry.low.constant, entry.high.constant
            bound.first, bound.middle = place, place + len(entry.low.terms)
            for parameter, factor in (*entry.low.terms, *entry.high.terms):
                self.terms[place].parameter, self.terms[place].factor = parameter, factor
                place += 1
            bound.last = place

    def __dealloc__(self):
        free(self.bounds)
        free(self.terms)

    cdef void clip(self, double *arena, const LiveParameter *parameters) noexcept nogil:
        """Move the outputs into their bounds or to 0; NaN stays NaN."""
        cdef int index, slot
        cdef double low, high
        cdef const HeldBound *bound
        for index in range(self.count):
            bound = &self.bounds[index]
            low = self.sum(bound.first, bound.middle, bound.low, parameters)
            high = self.sum(bound.middle, bound.last, bound.high, parameters)
            for slot in range(bound.slot, bound.slot + bound.size):
                if arena[slot] < 0.0 and arena[slot] < low:
                    arena[slot] = fmin(low, 0.0)
                elif arena[slot] > 0.0 and arena[slot] > high:
                    arena[slot] = fmax(high, 0.0)

    cdef double sum(self, int first, int last, double constant, const LiveParameter *parameters) noexcept nogil:
        cdef int term
        for term in range(first, last):
            constant += self.terms[term].factor * parameters[self.terms[term].parameter].value
        return constant
