"""Tools for what hangs on a bus: who is there, setting drives up, moving and watching one. Each holds the bus as a run
would.
"""
