# cython: freethreading_compatible=True
"""Detection of a suspend, for the guardian and the report of a run."""

from cext.memory.shared_state cimport SharedState


def time_suspended(SharedState shared) -> int:
    """Return the ns for which the computer was suspended since the run began, 0 without a suspend."""
    return suspended_since(shared.layout)
