"""Text of results, faults, timing and the pre-flight table for the command line: data in, lines out."""
