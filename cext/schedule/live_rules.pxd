"""Live parameters in native memory, and the rules between them."""

from cpython.object cimport PyObject
from libc.stdint cimport int32_t

from cext.ring.mailbox cimport Letter

cdef struct LiveParameter:
    int32_t slot                # in the arena, -1 for a Python attribute only
    bint whole                  # an int or a bool
    double low, high
    double slew                 # unit per second; infinite for a step
    double built_slew           # at reset
    double built                # at reset
    double value
    double before               # value of the previous tick, while `advance` runs
    double target
    bint changed                # in this tick
    int group                   # of parameters that rules relate, directly or through others; -1: no rule
    PyObject *block             # owner of the attribute, or NULL

cdef struct Term:               # factor · value
    int32_t parameter
    double factor

cdef struct LiveRule:           # Σ first to middle + small <= Σ middle to last + large
    int first, middle, last     # terms
    double small, large
    bint strict                 # < instead of <=
    int group

cdef class LiveRules:
    cdef readonly list entries  # cext.rules.LiveRule of each
    cdef LiveRule *rules
    cdef Term *terms
    cdef double *values         # one for each parameter
    cdef int count, parameter_count

    cdef list groups(self)
    cdef bint allow(self, const LiveParameter *parameters, const Letter *letter) noexcept nogil
    cdef void keep(self, LiveParameter *parameters, double dt) noexcept nogil
    cdef void straighten(self, LiveParameter *parameters, int group, double dt) noexcept nogil
    cdef void follow_line(self, const LiveParameter *parameters, int group, double share) noexcept nogil
    cdef void hold_back(self, const LiveParameter *parameters, int group) noexcept nogil
    cdef bint hold_terms(self, const LiveParameter *parameters, int first, int last, double sign) noexcept nogil
    cdef bint move(self, const LiveParameter *parameters, int group) noexcept nogil
    cdef bint nearly_hold(self, int group) noexcept nogil
    cdef bint holds(self, const LiveRule *rule) noexcept nogil
    cdef bint touches(self, const LiveRule *rule, const Letter *letter) noexcept nogil
    cdef double sum(self, int first, int last, double constant) noexcept nogil


cdef inline double approach(double value, double target, double most) noexcept nogil:
    """Return a value that is nearer to the target by at most `most`, and never beyond it."""
    cdef double difference = target - value
    if difference <= most and -difference <= most:
        return target
    if difference > 0.0:
        value += most
        return value if value < target else target
    value -= most
    return value if value > target else target
