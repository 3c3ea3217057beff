# cython: freethreading_compatible=True
"""Networks that run in the tick."""

from libc.stdint cimport uintptr_t
from libc.string cimport memset

from cext.abi cimport ITEMS, OK, export, items, kernel_t
from cext.clock.histogram cimport Histogram
from cext.kernels.networks.model cimport FAILED, Inference, infer
from cext.kernels.networks.samples cimport NEEDED, Network, put_out, take_sample

NETWORK = items(
    (<Network *>ITEMS)[0],
    "plan[3] channel_scales[...] output_scales[...] operands[...] computed[...]")


cdef int tick_kernel(double *arena, const Network *at, const Network *sizes) noexcept nogil:
    cdef Inference *model = <Inference *><uintptr_t>arena[at.model]
    cdef float *operands = <float *>(arena + at.operands)
    cdef float *results = <float *>(arena + at.computed)
    if arena[at.count] == 0.0:
        memset(&model.times, 0, sizeof(Histogram))
    take_sample(arena, at, operands)
    if infer(model, operands, results) != 0:
        return FAILED
    arena[at.count] += 1.0
    arena[at.valid] = arena[at.count] >= arena[at.plan + NEEDED]
    put_out(arena, at, results, arena[at.valid])
    arena[at.age] = arena[at.overruns] = 0.0
    return OK


tick = export(<kernel_t>tick_kernel, NETWORK)
