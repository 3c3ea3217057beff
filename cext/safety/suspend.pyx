# cython: freethreading_compatible=True
"""Detection of a suspend or pause, for the guardian and the report of a run."""

from cext.memory.shared_state cimport SharedState


def time_suspended(SharedState shared) -> int:
    """Return the ns for which the computer was suspended since the run began, or the loop was paused; 0 for neither."""
    return suspended_since(shared.layout)


def was_paused(SharedState shared) -> bool:
    """Return whether the loop was paused while the computer ran."""
    return load_i64(&shared.layout.paused) != 0
