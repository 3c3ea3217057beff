"""A recording read and exported here, with the mcap package and with pandas: `python -m tests.peers reading`.

Each task is done in a process of its own, from a file that is in the cache of the kernel.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import runtime
from runtime.export import parquet
from runtime.recording import messages
from tests.runtime.runs import KNEE_EXO, ROOT, environment, finished

SIGNAL, TOPIC = "left/knee.torque", "/left"


def tickwork_signal(path, folder):
    return runtime.load(path)[SIGNAL]


def mcap_signal(path, folder):
    """The signal is at a fixed place of a message, so that nothing is decoded."""
    from mcap.reader import make_reader

    about = runtime.load(path).about
    subsystem = next(item for item in messages.subsystems(about["name"], about["signals"]) if item.topic == TOPIC)
    place = subsystem.dtype().fields[str([signal["path"] for signal in about["signals"]].index(SIGNAL))][1]
    with open(path, "rb") as file:
        content = make_reader(file).iter_messages(topics=[TOPIC], log_time_order=False)
        return np.array([np.frombuffer(message.data, "<f8", 1, place)[0] for _, _, message in content])


def tickwork_all(path, folder):
    return runtime.load(path).rows


def mcap_all(path, folder):
    """The messages as bytes, one after the other."""
    from mcap.reader import make_reader

    with open(path, "rb") as file:
        return sum(1 for _ in make_reader(file).iter_messages(log_time_order=False))


def tickwork_parquet(path, folder):
    parquet.write(runtime.load(path), f"{folder}/tickwork.parquet", lambda share: None)
    return Path(folder) / "tickwork.parquet"


def pandas_parquet(path, folder):
    runtime.load(path).table().to_parquet(f"{folder}/pandas.parquet", compression="zstd")
    return Path(folder) / "pandas.parquet"


TASKS = {
    "one signal": (tickwork_signal, mcap_signal),
    "all": (tickwork_all, mcap_all),
    "to Parquet": (tickwork_parquet, pandas_parquet),
}


def record(folder, duration):
    """Record the knee exoskeleton in virtual time. Returns the path of the recording. duration : s"""
    done = finished(KNEE_EXO, "--fast", "--duration", duration, "--record", folder, cwd=folder, timeout=600)
    assert done.returncode == 0, done.stderr
    return next(Path(folder).glob("*.mcap"))


def measured(name, path, folder):
    """Return (s of processor time, MB of memory at most, MB of the written file or None) of a task."""
    words = [sys.executable, "-m", "tests.peers.reading", name, str(path), str(folder)]
    done = subprocess.run(words, cwd=ROOT, env=environment(), capture_output=True, text=True, check=True, timeout=600)
    return json.loads(done.stdout)


def print_times(duration=600.0):
    """Print what it costs to read and export a recording of knee_exo. duration : s"""
    with tempfile.TemporaryDirectory() as folder:
        path = record(folder, duration)
        title = f"{duration / 3600:.3g} h of knee_exo, {path.stat().st_size / 1e6:.1f} MB"
        print("", f"{title:38}{'s of CPU':>12}{'MB':>10}{'MB written':>12}", sep="\n")
        for task, contenders in TASKS.items():
            for contender in contenders:
                seconds, memory, written = measured(contender.__name__, path, folder)
                size = "" if written is None else f"{written:12.1f}"
                label = f"{task}: {contender.__name__.partition('_')[0]}"
                print(f"  {label:36}{seconds:12.3g}{memory:10.0f}{size}")


def main(name, path, folder):
    task = next(item for contenders in TASKS.values() for item in contenders if item.__name__ == name)
    begun = time.process_time()
    result = task(path, folder)
    seconds = time.process_time() - begun
    written = os.path.getsize(result) / 1e6 if isinstance(result, Path) else None
    # getrusage would count what the parent had before exec
    memory = int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]) / 1024
    print(json.dumps([seconds, memory, written]))


if __name__ == "__main__":
    main(*sys.argv[1:])
