"""Foundations of all folders of runtime: errors, exception text, the system, child processes, optional dependencies."""
