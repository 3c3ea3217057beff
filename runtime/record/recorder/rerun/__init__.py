"""Rerun: a live run in its viewer, in a browser or in a file.

target      destination: a viewer, a browser, a file
scene       what is shown: plots, limits, limbs, inertial sensors
blueprint   layout of the viewer, from the scene
stream      conversion of rows and events to Rerun's columns and logs
process     separate process that feeds Rerun, because Rerun's queues can block
viewer      start of viewers and servers, on loopback by default

The service, which never blocks the recorder, is runtime.record.recorder.services.rerun.

`blueprint`, `stream`, `process` and `viewer` require the package `rerun-sdk`.
"""
