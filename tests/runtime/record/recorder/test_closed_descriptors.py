"""A block that closes descriptors which it did not open: the run still ends with a summary, and its files are whole."""

import signal
import time

import pytest

from tests.runtime.runs import Files, knee, started

pytestmark = pytest.mark.paced


@pytest.mark.parametrize("ending", ["signal", "duration"])
def test_run_with_closed_descriptors_ends_with_summary_and_complete_files(tmp_path, ending):
    close = "import os\n        self.closed = [os.closerange(3, 256), print('closed', flush=True)]"
    law = "if tick >= 20 and not hasattr(self, 'closed'): self.close()\n        return 1.0"
    path = knee(tmp_path, f"{law}\n\n    def close(self):\n        {close}")
    process = started(path, "--duration", "20" if ending == "signal" else "0.3", cwd=tmp_path)
    assert process.stdout.readline() == "closed\n"
    began = time.monotonic()
    if ending == "signal":
        process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=10)
    assert time.monotonic() - began < 2.0 and process.returncode == (130 if ending == "signal" else 0)
    assert "Traceback" not in err and "Bad file descriptor" not in err
    assert (
        out.startswith("knee: ")
        and "the report of the recorder is missing, because a block closed file descriptors" in out
    )
    files = Files(tmp_path / "recordings")
    assert files.sidecar["ended"] == ("stopped by SIGINT" if ending == "signal" else "ok")
    assert files.sidecar["ticks"] == len(files.table["tick"]) > 0
