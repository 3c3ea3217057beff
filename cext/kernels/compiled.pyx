# cython: freethreading_compatible=True
"""Controllers in shared libraries with the functions of cext/tickwork.h."""

import os
from struct import error, unpack_from
from tempfile import NamedTemporaryFile

from libc.math cimport NAN, floor
from libc.stdint cimport int32_t, uintptr_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy

from cext.abi cimport DT, FIRST_OWN_STATUS, ITEMS, OK, Rest, each, export, items, kernel_t

IN_USE, NOT_STARTED, FAILED, OUTSIDE = (
    IN_USE_STATUS, NOT_STARTED_STATUS, FAILED_STATUS, OUTSIDE_STATUS)
cdef enum:
    IN_USE_STATUS = FIRST_OWN_STATUS
    NOT_STARTED_STATUS
    FAILED_STATUS
    OUTSIDE_STATUS              # and the index of the output
    VERSION = 1                 # TICKWORK_VERSION
    SPARE = 8                   # doubles after the inputs and outputs

cdef extern from "<fenv.h>" nogil:
    ctypedef struct fenv_t:
        pass
    int fegetenv(fenv_t *environment)
    int fesetenv(const fenv_t *environment)

cdef extern from "<dlfcn.h>" nogil:
    int RTLD_NOW, RTLD_LOCAL
    void *dlopen(const char *path, int flags)
    void *dlsym(void *library, const char *name)
    int dlclose(void *library)
    const char *dlerror()

ctypedef int (*sizes_t)(int *inputs, int *outputs) noexcept nogil
ctypedef int (*init_t)(double period) noexcept nogil
ctypedef int (*step_t)(const double *given, double *results, double dt) noexcept nogil

cdef struct Bounds:
    double low, high
    int whole                   # 1 for an int or bool

cdef struct State:              # of one library
    init_t init
    step_t step
    double period
    double *given               # contiguous inputs and outputs of a step
    double *results
    Bounds *bounds              # of each output
    int output_count
    double count                # steps since the start
    int fresh                   # whether the library is in the state of the start
    int code                    # that a function of the library returned

cdef struct Compiled:
    int32_t state, count
    Rest inputs, outputs

COMPILED = items((<Compiled *>ITEMS)[0])


cdef class Library:
    """Controller in a private copy of a shared library. Raises ValueError if it is none.

    content : bytes of the file
    """

    cdef State state
    cdef void *handle
    cdef readonly int inputs, outputs       # numbers of doubles

    def __cinit__(self, bytes content):
        cdef fenv_t environment
        if is_cut(content):
            raise ValueError("its end is missing: compile or copy it again")
        with NamedTemporaryFile(suffix=".so") as copy:      # of a new name: dlopen returns the same library for the same
            copy.write(content)
            copy.flush()
            path = os.fsencode(copy.name)
            fegetenv(&environment)
            self.handle = dlopen(path, RTLD_NOW | RTLD_LOCAL)
            fesetenv(&environment)                          # -ffast-math would flush the denormals of all blocks
            if self.handle == NULL:
                raise ValueError(dlerror().decode(errors="replace").replace(f"{copy.name}: ", ""))
        version = (<sizes_t>self.function(b"tickwork_sizes"))(&self.inputs, &self.outputs)
        if version != VERSION:
            raise ValueError(f"its tickwork_sizes returns version {version}: compile it with the present tickwork.h, "
                             f"of version {VERSION}")
        if self.inputs < 0 or self.outputs < 0:
            raise ValueError(f"its tickwork_sizes returns {self.inputs} inputs and {self.outputs} outputs")
        self.state.init = <init_t>self.function(b"tickwork_init")
        self.state.step = <step_t>self.function(b"tickwork_step")
        self.state.output_count = self.outputs
        self.state.given = <double *>calloc(self.inputs + SPARE, sizeof(double))
        self.state.results = <double *>calloc(self.outputs + SPARE, sizeof(double))
        self.state.bounds = <Bounds *>calloc(self.outputs + 1, sizeof(Bounds))
        if self.state.given == NULL or self.state.results == NULL or self.state.bounds == NULL:
            raise MemoryError

    def __dealloc__(self):
        free(self.state.given)
        free(self.state.results)
        free(self.state.bounds)
        if self.handle != NULL:
            dlclose(self.handle)

    cdef void *function(self, bytes name) except NULL:
        cdef void *found = dlsym(self.handle, name)
        if found == NULL:
            raise ValueError(f"it has no function {name.decode()}: define it with C linkage, as in tickwork.h")
        return found

    def start(self, double period, bounds):
        """Set the state of the start. Returns what tickwork_init returned.

        period : s; bounds : (low, high, whether whole) of each output
        """
        cdef int index
        for index, (low, high, whole) in enumerate(bounds):
            self.state.bounds[index] = Bounds(low, high, whole)
        self.state.period = period
        return restart(&self.state)

    @property
    def address(self):
        """Address for the memory of a block."""
        return float(<uintptr_t>&self.state)

    @property
    def code(self):
        """Number that a function of the library returned last."""
        return self.state.code

    def result(self, int index):
        """Return an output as the library computed it last."""
        return self.state.results[index]


def is_cut(bytes content):
    """Return whether a segment of an ELF file lies beyond its end, where dlopen would end the process by SIGBUS."""
    if not content.startswith(b"\x7fELF\2\1"):
        return False                                        # dlopen names the mistake
    try:
        (first,), (length, count) = unpack_from("<Q", content, 32), unpack_from("<HH", content, 54)
        segments = [unpack_from("<QQQQ", content, first + length * number + 8) for number in range(count)]
    except error:
        return True
    return any(offset + size > len(content) for offset, _, _, size in segments)


cdef int restart(State *state) noexcept nogil:
    state.code = state.init(state.period)
    state.fresh, state.count = state.code == 0, 0.0
    return state.code


cdef int step_kernel(double *arena, const Compiled *at, const Compiled *sizes) noexcept nogil:
    cdef State *state = <State *><uintptr_t>arena[at.state]
    cdef const int32_t *places = each(at, at.inputs)
    cdef const int32_t *lengths = each(sizes, sizes.inputs)
    cdef double poison = 0.0
    cdef double *next = state.given
    cdef int i, k
    if arena[at.count] == 0.0 and not state.fresh and restart(state) != 0:
        return NOT_STARTED_STATUS
    if arena[at.count] != state.count:
        return IN_USE_STATUS
    for i in range(at.inputs.count):
        for k in range(lengths[i]):
            next[0] = arena[places[i] + k]
            poison += next[0] - next[0]         # 0, or NaN if an input is NaN or infinite
            next += 1
    places, lengths, next = each(at, at.outputs), each(sizes, sizes.outputs), state.results
    if poison != 0.0:
        for i in range(at.outputs.count):
            for k in range(lengths[i]):
                arena[places[i] + k] = NAN
        return OK
    state.fresh = 0
    arena[at.count] += 1.0
    state.count = arena[at.count]
    state.code = state.step(state.given, state.results, arena[DT])
    if state.code != 0:
        return FAILED_STATUS
    for k in range(state.output_count):
        if not inside(next[k], &state.bounds[k]):
            return OUTSIDE_STATUS + k
    for i in range(at.outputs.count):
        memcpy(arena + places[i], next, lengths[i] * sizeof(double))
        next += lengths[i]
    return OK


cdef inline bint inside(double y, const Bounds *bounds) noexcept nogil:
    return bounds.low <= y <= bounds.high and (not bounds.whole or floor(y) == y)      # false for NaN


step = export(<kernel_t>step_kernel, COMPILED)
