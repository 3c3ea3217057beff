"""The panel: a process beside the recorder that serves a page to the browser of the operator.

    runtime.record.panel.process    the process: starts with the plan of the run, ends with the run
    runtime.record.panel.view       what a page shows: state, newest row, live parameters, events
    runtime.record.panel.access     which connections are accepted, and what each page may do
    runtime.record.panel.orders     what a page may ask for, and how the run is asked
    runtime.record.panel.site       HTTP for the files of a page and access to its WebSocket, on one port
    runtime.record.panel.server     the WebSockets, who has the controls, and the link that the run watches
    runtime.record.panel.pages      one open page: the messages to it, and its orders
    runtime.record.panel.foxglove   the same for a client of Foxglove's protocol
    runtime.record.panel.page       the page itself: HTML, CSS, JavaScript, and uPlot for the plots

It reads the shared state as `set` does, and takes nothing out of the ring. A page stops the run through the flag of the
operator, and changes live parameters and sets marks through the mailbox, whose bounds are private to the loop. It never
arms. The loop neither waits for the panel nor depends on it.
"""
