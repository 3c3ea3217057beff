"""The program of a schedule, its life cycle, and the threads and records that follow it."""
