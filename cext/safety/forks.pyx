# cython: freethreading_compatible=True
"""Children of a run. A block that forks and returns in the child too would run the loop, its buses and its recording a second time.

The child of a fork is marked by the C library itself, so that C code is seen as well as os.fork. A child that executes another program, or
that ends by itself as those of multiprocessing do, never comes back into the loop and is left alone.
"""

from libc.string cimport strlen
from posix.unistd cimport _exit, write

from cext.posix cimport pthread_atfork

cdef int32_t child = 0
cdef const char *MESSAGE = b"tickwork: a block has forked and its child process returned into the loop: the child ends here, the run continues\n"


cdef void mark() noexcept nogil:
    global child
    child = 1


cdef void begin_run() noexcept nogil:
    """From now on forks count; a process that was forked before may run a loop of its own."""
    global child
    child = 0


cdef bint is_child() noexcept nogil:
    return child != 0


cdef void leave() noexcept nogil:
    """End the child at once: no safe stop, no file, nothing that belongs to its parent."""
    write(2, MESSAGE, strlen(MESSAGE))
    _exit(1)


pthread_atfork(NULL, NULL, mark)
