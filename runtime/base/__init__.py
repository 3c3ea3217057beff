"""Foundations of every room: errors, text of exceptions, the system, child processes, optional dependencies."""
