"""A page in a real browser without a window: a script is run in it, and what it returns comes back."""

import html
import json
import os
import re
import shutil
import subprocess

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
BROWSER = next(filter(shutil.which, NAMES), None)
needs_browser = pytest.mark.skipif(BROWSER is None, reason=f"no browser here: none of {', '.join(NAMES)}")

QUIET = [
    "--headless",
    *["--no-sandbox"] * (os.geteuid() == 0),
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]  # without a window, and without a network

HOOK = """
<pre id="told"></pre>
<script>
const report = (told) => { document.getElementById("told").textContent = JSON.stringify(told); };
addEventListener("error", (event) => report({ error: event.message }));
(async () => {
  const wait = (ms) => new Promise((done) => setTimeout(done, ms));
  let told;
  try { told = { value: await (async () => { %s })() }; }
  catch (error) { told = { error: String(error.stack || error) }; }
  report(told);
})();
</script>
</body>"""


def browse(text, script, folder, address="", motion=False):
    """What an asynchronous script returns that is run at the end of a page.

    text : of the page
    folder : for the page and the browser's own files
    address : what follows the page's name, such as "#left/knee"
    motion : whether things move; else they jump to where they belong
    """
    file = folder / "page.html"
    file.write_text(text.replace("</body>", HOOK % script), encoding="utf-8")
    still = [] if motion else ["--force-prefers-reduced-motion"]
    process = subprocess.run(
        [
            BROWSER,
            *QUIET,
            *still,
            f"--user-data-dir={folder / 'profile'}",
            "--window-size=1400,900",
            "--virtual-time-budget=4000",
            "--dump-dom",
            file.as_uri() + address,
        ],
        capture_output=True,
        text=True,
        timeout=120,
    )
    found = re.search(r'<pre id="told">(.*?)</pre>', process.stdout, re.S)
    assert found and found[1], f"the page did not answer: {process.stderr[-500:]}"
    told = json.loads(html.unescape(found[1]))
    assert "error" not in told, told["error"]
    return told["value"]
