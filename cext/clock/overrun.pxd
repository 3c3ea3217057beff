from libc.stdint cimport int64_t

cdef class Overrun:
    cdef readonly int64_t catch_up   # limit of ticks that run late back to back
    cdef readonly int64_t in_a_row   # missed grid points in a row that are a fault, 0: never
    cdef readonly int64_t in_window  # missed grid points in a window that are a fault, 0: never
    cdef readonly int64_t window     # length of the window in grid points
    cdef readonly bint fault
    cdef int64_t late                # ticks that have run late, back to back
    cdef int64_t lately              # grid points missed within the window
    cdef char *missed                # flag of each grid point of the window, at its number modulo the window

    cpdef void reset(self) noexcept nogil
    cpdef int64_t decide(self, int64_t tick, int64_t newest) noexcept nogil
    cdef void remember(self, int64_t tick, int64_t count, char missed) noexcept nogil
