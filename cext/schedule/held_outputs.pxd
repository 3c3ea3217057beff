"""Bounds of outputs that a block keeps while it does not run."""

from cext.schedule.live_rules cimport LiveParameter, Term

cdef struct HeldBound:          # low + Σ first to middle <= each number <= high + Σ middle to last
    int slot, size
    int first, middle, last     # terms
    double low, high

cdef class HeldOutputs:
    cdef HeldBound *bounds
    cdef Term *terms
    cdef int count

    cdef void clip(self, double *arena, const LiveParameter *parameters) noexcept nogil
    cdef double sum(self, int first, int last, double constant, const LiveParameter *parameters) noexcept nogil
