# cython: freethreading_compatible=True
"""Bodies that MuJoCo simulates: ports, control and steps, by the functions of its library."""

from libc.stdint cimport int32_t, uintptr_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy

from cext.abi cimport FIRST_OWN_STATUS, ITEMS, OK, Rest, each, export, items, kernel_t

UNSTABLE, IN_USE = FIRST_OWN_STATUS, FIRST_OWN_STATUS + 1
cdef enum:
    UNSTABLE_STATUS = FIRST_OWN_STATUS
    IN_USE_STATUS = FIRST_OWN_STATUS + 1
    WARNINGS = 6                # of a bad control, position, velocity, acceleration; contacts, constraints left out

ctypedef void (*step_t)(void *model, void *data) noexcept nogil
ctypedef void *(*copy_t)(void *target, void *model, void *source) noexcept nogil
ctypedef void (*warn_t)(const char *text) noexcept nogil

cdef struct State:              # of one mjData
    step_t step                 # mj_step
    copy_t copy                 # mj_copyData
    warn_t *warn                # mju_user_warning
    warn_t ignore               # takes its place in a step
    void *model
    void *data
    void *initial               # mjData of the start
    int32_t *warnings[WARNINGS] # numbers of warnings
    double **targets            # of the inputs
    double **sources            # of the outputs
    double count                # steps of the block since the start

cdef struct Body:
    int32_t state, steps, count
    Rest inputs, outputs

BODY = items((<Body *>ITEMS)[0])


cdef class Simulation:
    """State of a simulation, at `address`.

    functions : addresses of mj_step, mj_copyData and mju_user_warning
    model, data, initial : mjModel and mjData of the bindings; `initial` is the start
    warnings : addresses of the numbers of the warnings that end a run, six
    targets, sources : addresses of the first double of each input and output
    """

    cdef State state
    cdef readonly object kept

    def __cinit__(self, functions, model, data, initial, warnings, targets, sources):
        self.kept = model, data, initial
        self.state.step = <step_t><uintptr_t>functions[0]
        self.state.copy = <copy_t><uintptr_t>functions[1]
        self.state.warn = <warn_t *><uintptr_t>functions[2]
        self.state.ignore = ignore_warning
        self.state.model = <void *><uintptr_t>model._address
        self.state.data = <void *><uintptr_t>data._address
        self.state.initial = <void *><uintptr_t>initial._address
        self.state.targets = pointers(targets)
        self.state.sources = pointers(sources)
        for k in range(WARNINGS):
            self.state.warnings[k] = <int32_t *><uintptr_t>warnings[k]

    def __dealloc__(self):
        free(self.state.targets)
        free(self.state.sources)

    @property
    def address(self):
        """Address for the memory of a block."""
        return float(<uintptr_t>&self.state)


cdef double **pointers(addresses) except NULL:
    cdef double **made = <double **>calloc(len(addresses) + 1, sizeof(double *))
    if made == NULL:
        raise MemoryError
    for k, address in enumerate(addresses):
        made[k] = <double *><uintptr_t>address
    return made


cdef void ignore_warning(const char *text) noexcept nogil:
    """Receive the warnings of mj_step, which MuJoCo would write to a file: the block reads their numbers."""


cdef int observe_kernel(double *arena, const Body *at, const Body *sizes) noexcept nogil:
    cdef State *state = <State *><uintptr_t>arena[at.state]
    cdef int k
    if arena[at.count] == 0.0:
        state.copy(state.data, state.model, state.initial)
        state.count = 0.0
    if arena[at.count] != state.count:
        return IN_USE_STATUS
    for k in range(at.outputs.count):
        memcpy(
            arena + each(at, at.outputs)[k], state.sources[k], each(sizes, sizes.outputs)[k] * <int>sizeof(double))
    return OK


cdef int advance_kernel(double *arena, const Body *at, const Body *sizes) noexcept nogil:
    cdef State *state = <State *><uintptr_t>arena[at.state]
    cdef warn_t warn = state.warn[0]
    cdef int k, status = OK
    cdef int steps = <int>arena[at.steps]
    for k in range(at.inputs.count):
        state.targets[k][0] = arena[each(at, at.inputs)[k]]
    state.warn[0] = state.ignore
    while steps > 0 and status == OK:
        state.step(state.model, state.data)
        for k in range(WARNINGS):
            if state.warnings[k][0] != 0:
                status = UNSTABLE_STATUS
        steps -= 1
    state.warn[0] = warn
    arena[at.count] += 1.0
    state.count = arena[at.count]
    return status


observe = export(<kernel_t>observe_kernel, BODY)
advance = export(<kernel_t>advance_kernel, BODY)
