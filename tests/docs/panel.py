"""Pictures of the panel and of `view`: `python -m tests.docs.panel`, with Chromium, renews docs/how_to/images."""

import shutil
import subprocess
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from PIL import Image

from tests.runtime.record.panel.chromium import browser
from tests.runtime.record.panel.panels import free_port
from tests.runtime.record.view.recorded import viewing
from tests.runtime.runs import finished, started, write

ROOT = Path(__file__).resolve().parents[2]
IMAGES = ROOT / "docs" / "how_to" / "images"
COLOURS = 96  # of a picture
WALKING_TIME = 14.0  # s until the plots show strides
DIAGRAM = """
import knee_exo
from blocks.sinks import Panel
from knee_exo import plant

diagram = knee_exo.build()
with diagram:
    Panel(marks=("start", "uphill", "level"), subject="left/knee.position", stride="maximum", target=(1.0, 1.15))
"""
# name: (path, width, height, dark, script)
PICTURES = {
    "panel_operate": ("", 1280, 900, False, "document.querySelector('#marks button').click()"),
    "panel_engineer": (
        "",
        1680,
        1050,
        True,
        "document.getElementById('tab-plots').click(); document.getElementById('average').click()",
    ),
    "panel_subject": ("subject", 1024, 640, False, ""),
}
VIEW_PICTURES = {  # name: (recordings, the two trials without, width, height, dark, script)
    "view_signals": (
        ["recordings"],
        1280,
        900,
        False,
        "for (const id of ['signals', 'happened']) document.getElementById(id).open = true; "
        "for (const key of ['p', '+']) dispatchEvent(new KeyboardEvent('keydown', { key }))",
    ),
    "view_strides": ([], 1280, 1000, True, "document.getElementById('tab-strides').click()"),
}


def main() -> None:
    """Take the pictures of a run of the knee exoskeleton."""
    IMAGES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder, port = Path(name), free_port()
        shutil.copy(ROOT / "diagrams" / "knee_exo.py", folder)
        write(folder, DIAGRAM, "knee_exo_trial.py")
        words = ("knee_exo_trial.py", "--panel", f"127.0.0.1:{port}")
        run = stack.enter_context(started(*words, cwd=folder, cold=True, stdout=subprocess.DEVNULL))
        stack.callback(run.terminate)
        while "panel:" not in run.stderr.readline():
            assert run.poll() is None
        new_tab = stack.enter_context(browser(folder))
        tabs = {path: new_tab(f"http://127.0.0.1:{port}/{path}") for path in ("", "subject")}
        time.sleep(WALKING_TIME)
        for picture, (path, width, height, dark, script) in PICTURES.items():
            tabs[path].call("Page.bringToFront")  # a page in the background draws nothing
            tabs[path].look(width, dark, height)
            tabs[path].evaluate(script)
            time.sleep(2.0)
            save(tabs[path], picture)
        run.terminate()
        run.communicate(timeout=30)
        trials = [record(folder, name, scale) for name, scale in (("without", 0.0), ("assisted", 0.8))]
        for picture, (words, width, height, dark, script) in VIEW_PICTURES.items():
            with viewing(folder, *(words or trials)) as (_, address):
                tab = new_tab(address)
                tab.look(width, dark, height)
                tab.wait_for("/\\d/.test(document.querySelector('.legend .value')?.innerText)")
                tab.evaluate(script)
                time.sleep(2.0)
                save(tab, picture)


def record(folder: Path, name: str, scale: float) -> Path:
    """Record a run in virtual time. Returns the folder of the recording."""
    words = ("knee_exo.py", "--fast", "--duration", "40", "--record", name, "--trial", f"condition={name}")
    assert finished(*words, "--set", f"*/profile.scale={scale}", cwd=folder).returncode == 0
    return folder / name


def save(tab, picture: str) -> None:
    """Write a picture of what a tab shows."""
    file = IMAGES / f"{picture}.png"
    tab.picture(file)
    Image.open(file).convert("RGB").quantize(COLOURS).save(file, optimize=True)


if __name__ == "__main__":
    main()
