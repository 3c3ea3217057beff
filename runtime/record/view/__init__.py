"""Recordings in the browser: `view RECORDING...`, one process that serves one page.

    runtime.record.view.levels      signals at several levels of detail: minimum and maximum of intervals
    runtime.record.view.recording   one recording, as pages show it: description, events, windows of its signals
    runtime.record.view.average     the average stride of each leg, of one recording or several
    runtime.record.view.server      the WebSocket of each page
    runtime.record.view.page        the page, beside the files that it shares with the panel

The process reads each file once, keeps minima and maxima of its signals, and sends a page what fits its pixels. Only
browsers of this account on this computer can open the page.
"""
