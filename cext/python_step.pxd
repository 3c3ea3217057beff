from cpython.object cimport PyObject
from libc.stdint cimport int32_t

cdef class PythonStep:
    cdef object callable
    cdef readonly str name
    cdef int input_count, output_count
    cdef int[32] input_kinds
    cdef int32_t[32] input_slots
    cdef int[32] output_kinds
    cdef int32_t[32] output_slots
    cdef double[32] output_lows
    cdef double[32] output_highs
    cdef PyObject *arguments[33]
    cdef list input_views, output_views, input_names, output_names
    cdef int call(self, double *arena) except -1
    cdef int refuse(self, int index, value) except -1
    cdef int store_array(self, int index, object value, double *arena) except -1
    cdef int store(self, int index, object value, double *arena) except -1
