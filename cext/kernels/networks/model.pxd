from libc.stdint cimport int64_t

from cext.clock.histogram cimport Histogram
from cext.kernels.networks.ort cimport Api

cdef enum:
    RANK_LIMIT = 8
    TENSOR_LIMIT = 64               # inputs, and outputs
    ERROR_BYTES = 400

cpdef enum: # statuses of the kernels, from FIRST_OWN_STATUS on
    FAILED = 64                     # the inference
    STALE = 65
    IN_USE = 66                     # by another program at the same time
    NO_THREAD = 67

cdef struct Tensor:
    const char *name
    int64_t shape[RANK_LIMIT]
    size_t rank
    size_t size                     # floats
    size_t place                    # first float in the buffer of all inputs, or of all outputs

cdef struct Inference:              # one session, with its tensors: the signal or results first, then the states
    const Api *api
    void *session
    void *memory                    # OrtMemoryInfo of buffers
    int input_count
    int output_count
    Tensor inputs[TENSOR_LIMIT]
    Tensor outputs[TENSOR_LIMIT]
    size_t signal_size              # floats of the first input
    size_t result_size              # floats of all outputs before the states
    size_t state_size               # floats of all states
    Histogram times                 # of the inferences of the present run
    char error[ERROR_BYTES]         # of the first inference that failed

cdef int infer(Inference *model, float *inputs, float *outputs) noexcept nogil

cdef class Model:
    cdef Inference inference
    cdef readonly dict inputs, outputs
    cdef readonly str metadata, version
    cdef bytes content
    cdef list names
    cdef object __weakref__

    cdef size_t place(self, list tensors, Tensor *into, int first)
    cdef describe(self, const Api *api, void *session, bint of_inputs)
    cdef str look_up(self, const Api *api, const char *key)
