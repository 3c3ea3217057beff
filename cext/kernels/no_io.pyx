# cython: freethreading_compatible=True
"""The decode of a device that receives nothing, and the encode of a device that sends nothing."""

from libc.stdint cimport int32_t

from cext.abi cimport FOREIGN, Frame, export_decode, export_encode


cdef int ignore_all_decode(double *arena, const int32_t *slots, const int32_t *sizes,
        const Frame *frame) noexcept nogil:
    return FOREIGN


cdef int send_nothing_encode(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    return 0


ignore_all, send_nothing = export_decode(ignore_all_decode, ()), export_encode(send_nothing_encode, ())
