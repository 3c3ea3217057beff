# cython: freethreading_compatible=True
"""Detection of forked children.

If a block forks and returns in the child, too, the child must not run the loop with its buses and recording. The C
library marks the child of a fork, which covers C code as well as os.fork. A child that executes another program, or
ends without returning, as those of multiprocessing do, is not affected.
"""

from libc.string cimport strlen
from posix.unistd cimport _exit, write

from cext.posix cimport pthread_atfork

cdef int32_t child = 0
cdef const char *MESSAGE = (
    b"tickwork: a block forked, and its child process returned to the loop: the child was ended, the run continues\n")


cdef void mark() noexcept nogil:
    global child
    child = 1


cdef void begin_run() noexcept nogil:
    """Detect forks from now on; a process that was forked earlier may run its own loop."""
    global child
    child = 0


cdef bint is_child() noexcept nogil:
    return child != 0


cdef void leave() noexcept nogil:
    """End the child at once, without a safe stop, and without touching files of its parent."""
    write(2, MESSAGE, strlen(MESSAGE))
    _exit(1)


pthread_atfork(NULL, NULL, mark)
