# cython: freethreading_compatible=True
"""Addresses of native kernels that Python hands over, and the tables of their calls."""

import numpy as np

from cext.kernel import Kernel

from cpython.pycapsule cimport PyCapsule_CheckExact, PyCapsule_GetPointer
from libc.stdint cimport int32_t, int64_t, uint8_t, uint32_t, uintptr_t
from libc.string cimport memcpy, memset

from cext.abi cimport DECODE, ENCODE, KERNEL, Frame, decode_t, kernel_t


def address(kernel, kind="kernel") -> int:
    """Return the address of a native function: of a Kernel, or of what a Kernel holds.

    kind is "kernel", "decode" or "encode". Raises TypeError for any other object or signature.
    """
    cdef const char *name = DECODE() if kind == "decode" else ENCODE() if kind == "encode" else KERNEL()
    if isinstance(kernel, Kernel):
        kernel = kernel.function
    if PyCapsule_CheckExact(kernel):
        try:
            return <uintptr_t>PyCapsule_GetPointer(kernel, name)
        except ValueError:
            raise TypeError("the capsule of a native %s must be named %r, got %r" % (kind, name.decode(),
                kernel)) from None
    if isinstance(getattr(kernel, "address", None), int):
        return int(kernel.address)
    import ctypes

    arguments = 3 if kind == "kernel" else 4
    if not isinstance(kernel, ctypes._CFuncPtr):
        raise TypeError("a native %s must be a PyCapsule, a ctypes function or a Numba cfunc, got %r" % (kind, kernel))
    if kernel.argtypes is not None and len(kernel.argtypes) != arguments:
        raise TypeError("a native %s takes %d arguments, but %r takes %d"
                        % (kind, arguments, kernel, len(kernel.argtypes)))
    function = ctypes.cast(kernel, ctypes.c_void_p).value
    if not function:
        raise TypeError("a native %s cannot be a null pointer" % kind)
    return int(function)


def call_kernel(kernel, double[::1] arena, table) -> int:
    """Run one kernel once, with the GIL, and return its status. For `block.step` and tests, not for the tick.

    table : graph.arena_layout.KernelTable
    """
    cdef kernel_t function = <kernel_t><uintptr_t>address(kernel)
    cdef int32_t[::1] slots = words(table.slots)
    cdef int32_t[::1] sizes = words(table.sizes)
    return function(&arena[0], &slots[0], &sizes[0])


def words(values) -> np.ndarray:
    """Return integers as an array of int32, with one element at least."""
    return np.array(list(values) or [0], dtype=np.int32)


def feed(decode, double[::1] arena, table, const unsigned char[::1] data, int chunk=64, int64_t time=0,
        uint32_t identifier=0, int flags=0) -> dict[int, int]:
    """Offer a stream of bytes to a device's decode, in frames of `chunk` bytes.

    Returns {return value of decode: count}.

    For tests, tools and measurements, not for the tick. time : ns, of all frames
    """
    cdef decode_t function = <decode_t><uintptr_t>address(decode, "decode")
    cdef int32_t[::1] slots = words(table.slots)
    cdef int32_t[::1] sizes = words(table.sizes)
    cdef int64_t counts[16]
    cdef Frame frame
    cdef Py_ssize_t at = 0
    cdef Py_ssize_t length = len(data)
    cdef int size, answer
    memset(counts, 0, sizeof(counts))
    memset(&frame, 0, sizeof(Frame))
    frame.time, frame.id, frame.flags = time, <uint32_t>identifier, <uint8_t>flags
    with nogil:
        while True:
            size = <int>min(<Py_ssize_t>chunk, length - at)
            if size > 0:
                memcpy(frame.data, &data[at], size)
            frame.length = <uint8_t>size
            answer = function(&arena[0], &slots[0], &sizes[0], &frame)
            counts[(answer + 1) & 15] += 1
            at += size
            frame.flags = 0
            if at >= length:
                break
    return {answer - 1: counts[answer] for answer in range(16) if counts[answer]}
