"""`python -m runtime bench`: what this machine takes for a tick, a compile and a start, beside the same by hand and in
other frameworks.

netlists        the diagrams, as data
by_hand         the same as one straight line of plain Python, and of C
ours            Tickwork, native blocks and Python blocks
*_peer          other frameworks, where they are installed
measure         contenders in turn, checked against one reference first
compiling       how long a compile takes, and how that grows
starting        from the start of the process to the first tick, and its memory
command         the command line, and what it prints
"""
