# cython: freethreading_compatible=True
"""Python steps in the tick: floats out of the arena by vectorcall, results back into it."""

import numpy as np

from cpython.bool cimport PyBool_FromLong
from cpython.float cimport PyFloat_AS_DOUBLE, PyFloat_AsDouble, PyFloat_CheckExact, PyFloat_FromDouble
from cpython.long cimport PyLong_FromDouble
from cpython.ref cimport Py_DECREF, Py_XDECREF
from libc.math cimport isfinite
from libc.string cimport memset

cdef extern from "Python.h":
    PyObject *PyObject_Vectorcall(PyObject *callable, PyObject **arguments, size_t flags, PyObject *names)
    const size_t PY_VECTORCALL_ARGUMENTS_OFFSET

cdef extern from *:
    """
    static inline void tw_incref(PyObject *object) { Py_INCREF(object); }
    static inline int tw_reraise(void) { return -1; }
    """
    void incref "tw_incref"(object value)
    int raise_current "tw_reraise"() except -1

cdef enum:
    REAL
    INTEGER
    TRUTH
    ARRAY

KINDS = {"float": REAL, "int": INTEGER, "bool": TRUTH}


cdef class PythonStep:
    """A Python callable with its arguments taken from the arena and its results put there.

    Parameters
    ----------
    callable : called with one positional argument per input
    name : path of the block, for errors
    inputs : list of (name, slot, dtype, shape); dtype is "float", "int" or "bool"; a shape other than () is passed as a view
    outputs : list of (name, slot, dtype, shape, low, high); a result outside its range is an error, NaN passes
    arena : the float64 array that the slots point into
    """

    def __cinit__(self, callable, str name, inputs, outputs, arena):
        if len(inputs) > 32 or len(outputs) > 32:
            raise ValueError("%s: a Python block has at most 32 inputs and 32 outputs" % name)
        self.callable, self.name = callable, name
        self.input_count, self.output_count = len(inputs), len(outputs)
        self.input_views, self.output_views = [], []
        self.input_names, self.output_names = [port for port, *_ in inputs], [port for port, *_ in outputs]
        memset(self.arguments, 0, sizeof(self.arguments))
        for index, (port, slot, dtype, shape) in enumerate(inputs):
            self.input_slots[index] = slot
            self.input_kinds[index] = ARRAY if shape else KINDS[dtype]
            if shape:
                view = arena[slot : slot + int(np.prod(shape))].reshape(shape)
                view.flags.writeable = False
                self.input_views.append(view)
                self.arguments[index + 1] = <PyObject *>view
        for index, (port, slot, dtype, shape, low, high) in enumerate(outputs):
            self.output_slots[index] = slot
            self.output_lows[index], self.output_highs[index] = low, high
            self.output_kinds[index] = ARRAY if shape else KINDS[dtype]
            self.output_views.append(arena[slot : slot + int(np.prod(shape))].reshape(shape) if shape else None)

    cdef int call(self, double *arena) except -1:
        cdef int index, kind
        cdef double value
        cdef PyObject *result
        cdef object number
        for index in range(self.input_count):
            kind = self.input_kinds[index]
            if kind == ARRAY:
                continue
            value = arena[self.input_slots[index]]
            if kind == REAL:
                number = PyFloat_FromDouble(value)
            elif not isfinite(value):
                raise ArithmeticError("%s.%s is %r, which is neither a whole number nor a truth" % (
                    self.name, self.input_names[index], value))
            elif kind == INTEGER:
                number = PyLong_FromDouble(value)
            else:
                number = PyBool_FromLong(value != 0.0)
            Py_XDECREF(self.arguments[index + 1])
            self.arguments[index + 1] = <PyObject *>number
            incref(number)
        result = PyObject_Vectorcall(
            <PyObject *>self.callable, &self.arguments[1], self.input_count | PY_VECTORCALL_ARGUMENTS_OFFSET, NULL
        )
        if result == NULL:
            raise_current()
        try:
            if self.output_count == 1:
                if self.output_kinds[0] == REAL and PyFloat_CheckExact(<object>result):
                    value = PyFloat_AS_DOUBLE(<object>result)
                    if value < self.output_lows[0] or value > self.output_highs[0]:
                        self.refuse(0, value)
                    arena[self.output_slots[0]] = value
                else:
                    self.store(0, <object>result, arena)
            elif self.output_count > 1:
                if not isinstance(<object>result, (tuple, list)) or len(<object>result) != self.output_count:
                    raise TypeError("%s.step must return %d values (%s), and returned %r" % (
                        self.name, self.output_count, ", ".join(self.output_names), <object>result))
                for index in range(self.output_count):
                    self.store(index, (<object>result)[index], arena)
        finally:
            Py_DECREF(<object>result)
        return 0

    cdef int store(self, int index, object value, double *arena) except -1:
        cdef int kind = self.output_kinds[index]
        cdef double number
        try:
            if kind == ARRAY:
                view = self.output_views[index]
                if np.shape(value) != view.shape:
                    raise ValueError("shape %s where %s is declared" % (np.shape(value), view.shape))
                view[...] = value
                if np.any(view < self.output_lows[index]) or np.any(view > self.output_highs[index]):
                    self.refuse(index, value)
            else:
                number = value.__index__() if kind == INTEGER else PyFloat_AsDouble(value)
                if kind == TRUTH:
                    if number != number:
                        raise ValueError("NaN is neither true nor false")
                    number = number != 0.0
                if number < self.output_lows[index] or number > self.output_highs[index]:
                    self.refuse(index, value)
                arena[self.output_slots[index]] = number
        except (TypeError, ValueError, AttributeError) as error:
            raise TypeError("%s.step returned %r for %s: %s" % (self.name, value, self.output_names[index], error)) from None
        return 0

    cdef int refuse(self, int index, value) except -1:
        raise ArithmeticError("%s.%s is %r, outside the range [%g, %g] that it declares" % (
            self.name, self.output_names[index], value, self.output_lows[index], self.output_highs[index]))

    def __call__(self, arena):
        """Call it once on an arena of doubles; for tests and for `block.step`."""
        cdef double[::1] view = arena
        self.call(&view[0])

    def __dealloc__(self):
        cdef int index
        for index in range(self.input_count):
            if self.input_kinds[index] != ARRAY:
                Py_XDECREF(self.arguments[index + 1])
