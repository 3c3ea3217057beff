# cython: freethreading_compatible=True
"""Python steps of a tick: arguments from the arena by vectorcall, results back into it."""

import numpy as np

from cpython.bool cimport PyBool_FromLong
from cpython.float cimport PyFloat_AS_DOUBLE, PyFloat_AsDouble, PyFloat_CheckExact
from cpython.long cimport PyLong_FromDouble
from cpython.ref cimport Py_DECREF, Py_XDECREF
from libc.math cimport isfinite
from libc.stdint cimport int64_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcmp, memcpy, memmove, memset

cdef extern from "Python.h":
    PyObject *PyObject_Vectorcall(PyObject *callable, PyObject **arguments, size_t flags, PyObject *names)
    const size_t PY_VECTORCALL_ARGUMENTS_OFFSET

cdef extern from *:
    """
    static inline void tw_incref(PyObject *object) { Py_INCREF(object); }
    static inline int tw_reraise(void) { return -1; }

    /* Store a float in a place. Reuse the object there if nothing else references it. */
    static inline int tw_put_float(PyObject **place, double value) {
        PyObject *old = *place;
    #ifndef Py_GIL_DISABLED
        if (old != NULL && Py_REFCNT(old) == 1 && PyFloat_CheckExact(old)) {
            ((PyFloatObject *)old)->ob_fval = value;
            return 0;
        }
    #endif
        *place = PyFloat_FromDouble(value);
        Py_XDECREF(old);
        return *place == NULL ? -1 : 0;
    }

    /* Head of NumPy's PyArrayObject. Its ABI fixes the layout, since macros such as PyArray_DATA compile to it. */
    typedef struct {
        PyObject_HEAD
        char *data;
        int axes;
        Py_ssize_t *shape, *strides;
        PyObject *base, *dtype;
        int flags;
    } tw_array;
    """
    ctypedef struct Array "tw_array":
        char *data
        int axes
        Py_ssize_t *shape
        PyObject *dtype
        int flags
    void incref "tw_incref"(object value)
    int raise_current "tw_reraise"() except -1
    int put_float "tw_put_float"(PyObject **place, double value) except -1

cdef enum:
    REAL
    INTEGER
    TRUTH
    ARRAY

cdef enum:
    C_CONTIGUOUS = 1            # flag of NumPy

cdef object NDARRAY = np.ndarray
cdef object FLOAT = np.dtype(np.float64)
KINDS = {"float": REAL, "int": INTEGER, "bool": TRUTH}


class Text:
    """Text of an exception, formed on request: the values are user objects, whose `__repr__` may never return.

    template : as of %
    values : one for each place of the template
    """

    def __init__(self, template, *values):
        self.template, self.values = template, values

    def __str__(self):
        return self.template % self.values


cdef class PythonStep:
    """A Python callable with arguments from the arena and results stored there.

    Parameters
    ----------
    callable : called with one positional argument per input
    name : path of the block, for errors
    inputs : list of (name, slot, dtype, shape); dtype is "float", "int" or "bool"; a shape other than () is passed as a
        view
    outputs : list of (name, slot, dtype, shape, low, high); a result outside its range is an error, NaN passes
    arena : the float64 array that the slots point into
    hold : limit of exceptions in a row that are held: the outputs keep their last values, once there are any
    """

    def __cinit__(self, callable, str name, inputs, outputs, arena, int hold=0):
        if len(inputs) > 32 or len(outputs) > 32:
            raise ValueError("%s: a Python block has at most 32 inputs and 32 outputs" % name)
        self.callable, self.name, self.hold = callable, name, hold
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
            self.output_sizes[index] = int(np.prod(shape))
        self.news = EventTemplate({"event": "exception held", "block": name})
        self.kept = <double *>calloc(1 + sum(self.output_sizes[i] for i in range(self.output_count)), sizeof(double))
        self.reset()

    cdef void reset(self):
        """Clear the held exceptions, kept values and counts."""
        self.in_a_row, self.held, self.first_held, self.last_held = 0, 0, -1, None
        self.given = self.output_count == 0
        self.has_news = False
        self.returned = 0
        memset(self.nans, 0, sizeof(self.nans))

    @property
    def nan(self) -> list[tuple[str, int]]:
        """(path of an output, number of steps in which it was NaN) of each output that was NaN."""
        return [("%s.%s" % (self.name, port), self.nans[index]) for index, port in enumerate(self.output_names)
            if self.nans[index]]

    cdef void count_nan(self, const double *arena) noexcept nogil:
        """Count a step that returned, and its outputs with a NaN."""
        cdef int index, place
        cdef const double *run
        self.returned += 1
        for index in range(self.output_count):
            run = arena + self.output_slots[index]
            for place in range(self.output_sizes[index]):
                if run[place] != run[place]:
                    self.nans[index] += 1
                    break

    cdef void publish(self, SharedLayout *layout) noexcept nogil:
        """Publish the event of the first held exception, once. `layout` may be NULL."""
        if self.has_news:
            self.has_news = False
            self.news.publish(layout, self.first_held)

    cdef int attempt(self, double *arena, int64_t tick) except -1:
        """Like `call`, but an exception keeps the outputs, `hold` times in a row. Returns 1 at the first held one.

        Exceptions that end a program, such as SystemExit, are never held.
        """
        self.keep(arena)
        try:
            self.call(arena)
        except Exception as error:
            if not self.given or self.in_a_row >= self.hold:
                raise
            self.put_back(arena)
            self.in_a_row += 1
            self.held += 1
            self.last_held = error
            if self.held == 1:
                self.first_held = tick
                return 1
            return 0
        self.in_a_row = 0
        self.given = True
        return 0

    cdef void keep(self, double *arena) noexcept nogil:
        cdef int index
        cdef double *kept = self.kept
        for index in range(self.output_count):
            memcpy(kept, arena + self.output_slots[index], self.output_sizes[index] * sizeof(double))
            kept += self.output_sizes[index]

    cdef void put_back(self, double *arena) noexcept nogil:
        """Restore the outputs after a step that raised."""
        cdef int index
        cdef double *kept = self.kept
        for index in range(self.output_count):
            memcpy(arena + self.output_slots[index], kept, self.output_sizes[index] * sizeof(double))
            kept += self.output_sizes[index]

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
                put_float(&self.arguments[index + 1], value)
                continue
            if not isfinite(value):
                raise ArithmeticError("%s.%s is %r, which is neither an int nor a bool" % (
                    self.name, self.input_names[index], value))
            if kind == INTEGER:
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
                    raise TypeError(Text(
                        "%s.step must return %d values (%s), but returned %r",
                        self.name, self.output_count, ", ".join(self.output_names), <object>result))
                for index in range(self.output_count):
                    self.store(index, (<object>result)[index], arena)
        finally:
            Py_DECREF(<object>result)
        self.count_nan(arena)
        return 0

    cdef int store(self, int index, object value, double *arena) except -1:
        cdef int kind = self.output_kinds[index]
        cdef double number
        try:
            if kind == ARRAY:
                self.store_array(index, value, arena)
            else:
                number = value.__index__() if kind == INTEGER else PyFloat_AsDouble(value)
                if kind == TRUTH:
                    if number != number:
                        raise ValueError("NaN is not a bool")
                    number = number != 0.0
                if number < self.output_lows[index] or number > self.output_highs[index]:
                    self.refuse(index, value)
                arena[self.output_slots[index]] = number
        except (TypeError, ValueError, AttributeError) as error:
            if isinstance(value, tuple) and kind != ARRAY and self.output_count == 1:
                raise TypeError(Text(
                    "%s.step returned %d values %r, and the block has one output, %s: return one value, or declare an "
                    "Output for each", self.name, len(value), value, self.output_names[index])) from None
            raise TypeError(
                Text("%s.step returned %r for %s: %s", self.name, value, self.output_names[index], error)
            ) from None
        return 0

    cdef int store_array(self, int index, object value, double *arena) except -1:
        cdef double *run = arena + self.output_slots[index]
        cdef Py_ssize_t i
        view = self.output_views[index]
        if has_layout_of(<PyObject *>value, <PyObject *>view):
            memmove(run, (<Array *><PyObject *>value).data, self.output_sizes[index] * sizeof(double))
        elif (<Array *><PyObject *>view).axes > 1 or not copy_floats(value, run, self.output_sizes[index]):
            if np.iscomplexobj(value):
                raise TypeError("must be real numbers, not complex")
            value = np.asarray(value, dtype=FLOAT)
            if value.shape != view.shape:
                raise ValueError("expected shape %s, got %s" % (view.shape, value.shape))
            view[...] = value
        for i in range(self.output_sizes[index]):
            if run[i] < self.output_lows[index] or run[i] > self.output_highs[index]:
                self.refuse(index, np.array(value))
        return 0

    cdef int refuse(self, int index, value) except -1:
        raise ArithmeticError(Text(
            "%s.%s is %r, outside its declared range [%g, %g]", self.name, self.output_names[index], value,
            self.output_lows[index], self.output_highs[index]))

    def __call__(self, arena):
        """Call the step once on an arena of doubles; for tests and for `block.step`."""
        cdef double[::1] view = arena
        self.call(&view[0])

    def __dealloc__(self):
        cdef int index
        free(self.kept)
        for index in range(self.input_count):
            if self.input_kinds[index] != ARRAY:
                Py_XDECREF(self.arguments[index + 1])


cdef bint has_layout_of(PyObject *value, PyObject *view) noexcept:
    """Return whether a value is an array of contiguous doubles in the shape of a view."""
    cdef const Array *one = <const Array *>value
    cdef const Array *other = <const Array *>view
    return (
        type(<object>value) is NDARRAY and one.dtype == <PyObject *>FLOAT and one.flags & C_CONTIGUOUS
        and one.axes == other.axes and memcmp(one.shape, other.shape, one.axes * sizeof(Py_ssize_t)) == 0)


cdef bint copy_floats(value, double *run, int count):
    """Copy a list or tuple of floats. Returns False for any other value, after it may have copied a part."""
    cdef int i
    if type(value) is not list and type(value) is not tuple or len(value) != count:
        return False
    for i in range(count):
        if not PyFloat_CheckExact(value[i]):
            return False
        run[i] = PyFloat_AS_DOUBLE(value[i])
    return True
