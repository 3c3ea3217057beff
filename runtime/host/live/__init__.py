"""Live parameters from outside the loop: their table in the shared state, running runs, and the `set` command.

    runtime.host.live.table      parameters: path, unit, bounds, present value
    runtime.host.live.patterns   `*/profile.scale` for both legs at once
    runtime.host.live.sending    changes of a run of another process
    runtime.host.live.running    the runs on this machine and their shared state
    runtime.cli.set         `python -m runtime set PID left/impedance.stiffness=40`

The shared state contains the table, so that a reader needs nothing else. The loop's side is cext.schedule.live.
"""
