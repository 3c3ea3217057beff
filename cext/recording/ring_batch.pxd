cdef class Batch:
    cdef bytes records                  # Header and payload of each
    cdef readonly Py_ssize_t size       # bytes of `records`
    cdef readonly int rows
    cdef readonly int frames
    cdef Py_ssize_t newest_at           # position of the newest row, -1 without one

    cdef fill(self, bytes records)
