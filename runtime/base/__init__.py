"""Foundations of all rooms: errors, exception text, the system, child processes, optional dependencies."""
