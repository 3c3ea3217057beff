"""Shared memory of the processes of a run: its state with the fence, the ring of its recording, robust mutexes."""
