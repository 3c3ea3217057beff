"""A run from preparation to end: arm, run, finish, replay, check."""
