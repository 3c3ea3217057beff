"""`python -m runtime`, and the console script `tickwork`.

SIGINT prints Python's own traceback only before the first statement here, while the interpreter starts: about 20 ms.
"""

import _signal  # pyright: ignore[reportMissingImports]  # built in: no file of the working folder can shadow it

if __name__ == "__main__" and _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
    _signal.signal(_signal.SIGINT, _signal.SIG_DFL)  # ends the process until runtime.host.ending is imported

import gc
import os
import sys

from runtime.host import working_folder

FOLDER = working_folder.move_back() if __name__ == "__main__" else None  # before anything that it could hide

from runtime.host import ending  # noqa: E402

if __name__ == "__main__":
    ending.leave_on_signals()

from runtime.host import installation_check, run_mark  # noqa: E402


def main(folder: "str | None" = FOLDER) -> None:
    """Check the installation, run the command line, and end the process with its exit code.

    folder : the folder that Python had put first on the path, None if it had not
    """
    ending.leave_on_signals()
    gc.disable()  # each pass would visit all that a start imports, and find no garbage; see runtime.cli.main.run
    occupy_standard_streams()
    run_mark.set_mark()
    try:
        code = _start(folder)
    except ending.Interrupted as interrupt:  # after its command
        ending.forget_interrupt()  # here, where it is not raised again
        code = 128 + interrupt.number
    ending.leave(code)


def _start(folder: "str | None") -> int:
    problem = installation_check.problem(*sys.argv[1:2], folder=folder)
    if problem is None:
        try:
            from runtime.cli.main import main as command_line

            return command_line(folder=folder)
        except ImportError as error:
            problem = installation_check.explain(error)
        except (EOFError, ValueError, TypeError) as error:
            problem = installation_check.damaged_cache(error)
            if problem is None:
                raise
    print(f"tickwork: {problem}", file=sys.stderr)
    return installation_check.BAD_INPUT


def occupy_standard_streams() -> None:
    """Open /dev/null for each closed standard stream, so that no file opened later gets its descriptor."""
    spare = os.open(os.devnull, os.O_RDWR)
    while spare <= 2:
        spare = os.open(os.devnull, os.O_RDWR)
    os.close(spare)


if __name__ == "__main__":
    main()
