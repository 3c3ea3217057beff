"""A recording read and exported here, with the mcap package and with pandas: `python -m tests.peers reading`.

Each task runs in a process of its own, from a file in the page cache. Its time is without the start of Python and the
imports of this module, its memory the peak of the process. pandas writes a table that Tickwork has read.
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
from runtime.record.export import parquet
from runtime.record.storage import messages
from tests.runtime.runs import KNEE_EXO, ROOT, environment, finished

SIGNAL, TOPIC = "left/knee.torque", "/left"


def tickwork_signal(path, folder):
    """Open the recording and return one signal."""
    return runtime.load(path)[SIGNAL]


def mcap_signal(path, folder):
    """Return the same signal from its fixed place in each message: nothing is decoded."""
    from mcap.reader import make_reader

    about = runtime.load(path).about
    subsystem = next(item for item in messages.subsystems(about["name"], about["signals"]) if item.topic == TOPIC)
    place = subsystem.dtype().fields[str([signal["path"] for signal in about["signals"]].index(SIGNAL))][1]
    with open(path, "rb") as file:
        content = make_reader(file).iter_messages(topics=[TOPIC], log_time_order=False)
        return np.array([np.frombuffer(message.data, "<f8", 1, place)[0] for _, _, message in content])


def tickwork_all(path, folder):
    """Return all signals, by path."""
    trial = runtime.load(path)
    return trial.read(trial.names)


def mcap_all(path, folder):
    """Return the number of messages, each of which is read as bytes."""
    from mcap.reader import make_reader

    with open(path, "rb") as file:
        return sum(1 for _ in make_reader(file).iter_messages(log_time_order=False))


def tickwork_parquet(path, folder):
    """Write a Parquet file and return its path."""
    parquet.write(runtime.load(path), f"{folder}/tickwork.parquet", lambda share: None)
    return Path(folder) / "tickwork.parquet"


def pandas_parquet(path, folder):
    """Write a Parquet file with the defaults of pandas and return its path."""
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
    """Return (s, s of processor time, peak memory in MB, size of the written file in MB or None) of a task."""
    words = [sys.executable, "-m", "tests.peers.reading", name, str(path), str(folder)]
    done = subprocess.run(words, cwd=ROOT, env=environment(), capture_output=True, text=True, check=True, timeout=600)
    return json.loads(done.stdout)


def print_times(duration=3600.0):
    """Print the cost of reading and exporting a recording of knee_exo. duration : s"""
    with tempfile.TemporaryDirectory() as folder:
        path = record(folder, duration)
        title = f"{duration / 3600:.3g} h of knee_exo, {path.stat().st_size / 1e6:.1f} MB"
        print("", f"{title:38}{'s':>10}{'s of CPU':>10}{'MB':>8}{'MB written':>12}", sep="\n")
        for task, contenders in TASKS.items():
            for contender in contenders:
                seconds, processor, memory, written = measured(contender.__name__, path, folder)
                size = "" if written is None else f"{written:12.1f}"
                label = f"{task}: {contender.__name__.partition('_')[0]}"
                print(f"  {label:36}{seconds:10.3g}{processor:10.3g}{memory:8.0f}{size}")


def main(name, path, folder):
    task = next(item for contenders in TASKS.values() for item in contenders if item.__name__ == name)
    begun, processor = time.perf_counter(), time.process_time()
    result = task(path, folder)
    seconds, processor = time.perf_counter() - begun, time.process_time() - processor
    written = os.path.getsize(result) / 1e6 if isinstance(result, Path) else None
    # getrusage would count what the parent had before exec
    memory = int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]) / 1024
    print(json.dumps([seconds, processor, memory, written]))


if __name__ == "__main__":
    main(*sys.argv[1:])
