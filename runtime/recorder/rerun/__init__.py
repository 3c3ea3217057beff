"""Rerun: a run while it goes on, or a recording, in its viewer.

target      where it goes: a viewer, a browser, a file
scene       what recorded signals become: plots, limits, limbs, inertial sensors
blueprint   the viewer's layout, made from the scene
catching_up what a recorder that has died had not handed over
stream      rows and events as Rerun's columns and logs
sender      the recorder's end: a service that never blocks
process     the other end, in a process of its own, as Rerun's queues block whoever fills them
viewer      the viewers and servers that it starts, on loopback unless told otherwise
conversion  a recording as a file

Only `blueprint`, `stream`, `process`, `viewer` and `conversion` need the library, which is called `rerun`, too.
"""
