"""The command line, a file a command: each has `main(arguments)`, which returns the exit code. `parsing` has what
several need.
"""
