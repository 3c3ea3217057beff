from cpython.object cimport PyObject
from libc.stdint cimport int32_t, int64_t

from cext.memory.event_template cimport EventTemplate
from cext.memory.shared_state cimport SharedLayout

cdef class PythonStep:
    cdef object callable
    cdef readonly str name
    cdef int input_count, output_count
    cdef int[32] input_kinds
    cdef int32_t[32] input_slots
    cdef int[32] output_kinds
    cdef int32_t[32] output_slots
    cdef int[32] output_sizes
    cdef double[32] output_lows
    cdef double[32] output_highs
    cdef PyObject *arguments[33]
    cdef readonly int hold               # limit of exceptions in a row that are held
    cdef int in_a_row
    cdef bint given                      # it has returned once, so that there are values to keep
    cdef double *kept                    # outputs of the previous step
    cdef readonly int64_t held           # number of held exceptions
    cdef readonly int64_t first_held     # tick of the first
    cdef readonly object last_held       # last held exception
    cdef readonly int64_t returned       # number of steps that returned
    cdef int64_t[32] nans                # of these, those in which an output was NaN
    cdef EventTemplate news              # event of the first
    cdef bint has_news                   # it is not published yet
    cdef list input_views, output_views, input_names, output_names
    cdef int call(self, double *arena) except -1
    cdef int attempt(self, double *arena, int64_t tick) except -1
    cdef void keep(self, double *arena) noexcept nogil
    cdef void put_back(self, double *arena) noexcept nogil
    cdef void reset(self)
    cdef void count_nan(self, const double *arena) noexcept nogil
    cdef void publish(self, SharedLayout *layout) noexcept nogil
    cdef int refuse(self, int index, value) except -1
    cdef int store_array(self, int index, object value, double *arena) except -1
    cdef int store(self, int index, object value, double *arena) except -1
