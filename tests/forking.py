"""Child processes of a test that share its objects."""

import os
import traceback


def fork(work):
    """Carry out `work` in a child process, which never returns to the tests. Returns its ID.

    It ends with what `work` returns as its exit code, 0 for None, or with 99 after an exception, which it prints.
    """
    child = os.fork()
    if child == 0:
        code = 99
        try:
            code = work() or 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)
    return child


def exit_code(child):
    """Wait for a child process to end. Returns its exit code, or the negative number of a signal."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
