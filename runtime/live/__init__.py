"""Live parameters from outside the loop: what a run's page tells of them, where the runs are, and the command that
changes them.

    runtime.live.table      what there is to change: path, unit, bounds, present value
    runtime.live.patterns   `*/profile.scale` for both legs at once
    runtime.live.running     the runs on this machine and their pages
    runtime.cli.set          `python -m runtime set PID left/impedance.stiffness=40`

The page carries the table, so that whoever can reach the page needs nothing else. The loop's side is
cext.schedule.live.
"""
