"""Random events of emulated devices, the same in every run."""

from libc.stdint cimport uint64_t


cdef inline bint lucky(double *luck, double share) noexcept nogil:
    """Return True with a probability. luck : state of the linear congruential generator, in the device's memory"""
    if not share > 0.0:
        return False
    luck[0] = <double>((<uint64_t>luck[0] * 1103515245u + 12345u) & 0x7FFFFFFFu)
    return luck[0] < share * 2147483648.0
