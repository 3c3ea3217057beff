"""Transport of recordings: readers of the ring in shared memory, and the encoder of MCAP records."""
