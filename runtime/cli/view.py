"""`view RECORDING...`: open recordings in the browser."""

from __future__ import annotations

import asyncio
import errno
import os
import signal
import webbrowser
from collections.abc import Sequence
from contextlib import suppress

from runtime.cli.parsing import Parser
from runtime.cli.reading import read
from runtime.host.console.progress import Progress
from runtime.host.console.terminal import print_lines
from runtime.host.errors import OK, BadInput
from runtime.host.options import whole_number
from runtime.record.analysis.conditions import trial_labels
from runtime.record.panel.site import FIRST_PORT
from runtime.record.storage.parts import heads, newest
from runtime.record.view.recording import Recording
from runtime.record.view.server import Viewer

RECORDINGS_LIMIT = 6  # that can be distinguished by their colours
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
EPILOG = """\
examples:
  view recordings                the newest recording of a folder
  view trial.mcap
  view without.mcap assisted.mcap
                                 trials over each other, by time or over the gait cycle
  view trial.mcap --no-browser --port 8500
                                 on a robot; from a laptop: ssh -L 8500:127.0.0.1:8500 robot
"""


def main(arguments: Sequence[str]) -> int:
    """Run the command until a signal ends it. Returns the exit code; raises BadInput for an unusable recording."""
    parser = Parser(
        "view",
        "Open recordings in the browser: signals, marks, faults, strides, trials over each other, and pictures of "
        "them. Only this account of this computer can open the page. Ctrl-C ends it.",
        EPILOG,
    )
    parser.add_argument(
        "recordings",
        type=newest,
        nargs="+",
        metavar="RECORDING",
        help="the .mcap file of a recording, or a folder: its newest",
    )
    parser.add_argument("--no-browser", action="store_true", help="only print the address of the page")
    parser.add_argument(
        "--port",
        type=whole_number("--port", 65535),
        metavar="N",
        help=f"port of the page (default: the first free one from {FIRST_PORT} on)",
    )
    options = parser.parse_args(arguments)
    paths = list(dict.fromkeys(heads(options.recordings)))
    if len(paths) > RECORDINGS_LIMIT:
        raise BadInput(f"{len(paths)} recordings: at most {RECORDINGS_LIMIT} can be distinguished. Pass fewer")
    with Progress(f"reading {paths[0].name}") as progress:
        share = 1.0 / len(paths)
        trials = [read(path, progress, number * share, (number + 1) * share) for number, path in enumerate(paths)]
    recordings = [Recording(trial, label) for trial, label in zip(trials, trial_labels(trials))]
    return asyncio.run(serve(Viewer(recordings), options.port, not options.no_browser))


async def serve(viewer: Viewer, port: int | None, browser: bool) -> int:
    """Serve pages until a signal ends the process. Returns the exit code: OK for Ctrl-C.

    browser : whether the page is opened in a browser, if there is a display
    """
    ended: asyncio.Future[int] = asyncio.get_running_loop().create_future()
    for number in ENDING:
        asyncio.get_running_loop().add_signal_handler(
            number, lambda number=number: ended.done() or ended.set_result(number)
        )
    try:
        await viewer.listen_first(port)
    except OSError as error:
        another = ". Pass another one, as in --port 8500" if error.errno == errno.EADDRINUSE else ""
        raise BadInput(f"{error.strerror}{another}") from None
    print_lines([viewer.address])
    if browser:
        await asyncio.to_thread(open_page, viewer.address)
    building = asyncio.create_task(viewer.build())
    await asyncio.wait([ended, building], return_when=asyncio.FIRST_COMPLETED)
    if building.done():
        building.result()  # a file that has changed
    number = await ended
    await viewer.close()
    return OK if number == signal.SIGINT else 128 + number


def open_page(address: str) -> None:
    """Open a page if there is a display, and a browser that does not take the terminal."""
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return
    with suppress(webbrowser.Error):
        if type(found := webbrowser.get()) is not webbrowser.GenericBrowser:
            found.open(address)
