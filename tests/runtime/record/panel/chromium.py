"""A real browser without a window, driven over the DevTools protocol: clicks, keys, scripts, pictures."""

import base64
import contextlib
import itertools
import json
import subprocess
import time
import urllib.request
from pathlib import Path

from websockets.sync.client import connect

from tests.graph.drawing.browser import BROWSER, QUIET


class Tab:
    """One open page."""

    def __init__(self, socket):
        self.socket, self.numbers, self.problems = socket, itertools.count(1), []

    def call(self, method, **parameters):
        number = next(self.numbers)
        self.socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self.socket.recv(timeout=30))
            if message.get("id") == number:
                assert "error" not in message, message
                return message["result"]
            self.note(message)

    def note(self, message):
        """Keep what the page reports as wrong."""
        parameters = message.get("params", {})
        if message["method"] == "Runtime.exceptionThrown":
            details = parameters["exceptionDetails"]
            self.problems.append(details.get("exception", {}).get("description") or details["text"])
        elif message["method"] == "Log.entryAdded" and parameters["entry"]["level"] == "error":
            self.problems.append(parameters["entry"]["text"])

    def evaluate(self, script):
        result = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def wait_for(self, script, timeout=10.0):
        """Wait until a script returns a true value, and return it."""
        until = time.monotonic() + timeout
        while not (value := self.evaluate(script)):
            assert time.monotonic() < until, (
                f"{script} did not become true; the page has {self.problems or 'no errors'}"
            )
            time.sleep(0.02)
        return value

    def open(self, address):
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        self.call("Page.navigate", url=address)
        self.wait_for("location.href !== 'about:blank' && document.readyState === 'complete'")

    def text(self, selector):
        return self.evaluate(f"document.querySelector({json.dumps(selector)}).innerText")

    def click(self, selector):
        place = self.evaluate(
            f"""(() => {{ const it = document.querySelector({json.dumps(selector)});
            it.scrollIntoView({{block: "center"}}); const box = it.getBoundingClientRect();
            return [box.x + box.width / 2, box.y + box.height / 2]; }})()"""
        )
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=place[0], y=place[1], button="left", clickCount=1)

    def upload(self, selector, path):
        """Choose a file for an input."""
        found = self.call("Runtime.evaluate", expression=f"document.querySelector({json.dumps(selector)})")
        self.call("DOM.setFileInputFiles", files=[str(path)], objectId=found["result"]["objectId"])

    def press(self, key, code):
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=code, text=key if kind == "keyDown" else "")

    def look(self, width, dark=False, height=1000):
        """Set the width of the window in px, and the colours that the person prefers."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        scheme = "dark" if dark else "light"
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])

    def picture(self, path):
        Path(path).write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))


@contextlib.contextmanager
def browser(folder):
    """Start a browser. Yields a function that opens an address in a new tab and returns the Tab."""
    profile = Path(folder) / "profile"
    process = subprocess.Popen(
        [BROWSER, *QUIET, "--remote-debugging-port=0", f"--user-data-dir={profile}", "about:blank"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    sockets = contextlib.ExitStack()
    try:
        ready, until = profile / "DevToolsActivePort", time.monotonic() + 60.0
        while not (ready.exists() and ready.read_text().count("\n")):
            assert process.poll() is None and time.monotonic() < until, "the browser did not start"
            time.sleep(0.05)
        base = f"127.0.0.1:{ready.read_text().splitlines()[0]}"

        def open_tab(address):
            request = urllib.request.Request(f"http://{base}/json/new?about:blank", method="PUT")
            with urllib.request.urlopen(request) as answer:
                target = json.load(answer)["webSocketDebuggerUrl"]
            tab = Tab(sockets.enter_context(connect(target, max_size=None)))
            tab.open(address)
            return tab

        yield open_tab
    finally:
        with contextlib.suppress(Exception):
            sockets.close()
        process.terminate()
        process.wait(30)
