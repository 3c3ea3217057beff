"""The command line: one file per command.

Each has `main(arguments)`, which returns the exit code. `parsing` has the options that several commands share.
"""
