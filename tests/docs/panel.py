"""Pictures of the panel for its page: `python -m tests.docs.panel`, with Chromium, renews docs/how_to/images."""

import shutil
import subprocess
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from PIL import Image

from tests.runtime.record.panel.chromium import browser
from tests.runtime.record.panel.panels import free_port
from tests.runtime.runs import started, write

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
            tabs[path].look(width, dark, height)
            tabs[path].evaluate(script)
            time.sleep(2.0)
            file = IMAGES / f"{picture}.png"
            tabs[path].picture(file)
            Image.open(file).convert("RGB").quantize(COLOURS).save(file, optimize=True)


if __name__ == "__main__":
    main()
