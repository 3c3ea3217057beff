"""A recording that is cut at any byte opens up to its last flushed tick."""

import random

import pytest

import runtime
from runtime.host.errors import BadInput
from runtime.record.storage import mcap_file
from runtime.record.storage.repair import Repair
from tests.runtime.record.storage.test_repair import write
from tests.soaking import soaked

FLUSH_ROWS = 20


@pytest.mark.parametrize("cuts", [25, pytest.param(1000, marks=pytest.mark.soak)])
@pytest.mark.parametrize("compression", soaked(["none", "zstd"], but=[1]))
def test_a_recording_that_is_cut_anywhere_opens_to_its_last_flushed_tick(tmp_path, monkeypatch, compression, cuts):
    sizes = []  # of the file, after each flush

    def flush(file):
        flushes(file)
        sizes.append(file.file.size)

    flushes = mcap_file.McapFile.flush
    monkeypatch.setattr(mcap_file.McapFile, "flush", flush)
    data = write(tmp_path, monkeypatch, compression, 600, FLUSH_ROWS, 64 << 10, 12)
    whole, path, dice = runtime.load(tmp_path / "long.mcap"), tmp_path / "cut.mcap", random.Random(cuts)
    assert len(sizes) == 600 // FLUSH_ROWS and len(whole) == 600
    for cut in sorted(dice.randrange(sizes[0], len(data)) for _ in range(cuts)):
        path.write_bytes(data[:cut])
        flushed = FLUSH_ROWS * sum(size <= cut for size in sizes)
        trial = runtime.load(path)
        assert len(trial) >= flushed and trial.tick.tolist() == list(range(len(trial)))
        assert trial.rows.tobytes() == whole.rows[: len(trial)].tobytes()
        Repair(str(path)).finish()
        assert runtime.load(path).rows.tobytes() == trial.rows.tobytes()
    path.write_bytes(data[: sizes[0] // 8])
    with pytest.raises(BadInput, match="truncated before its first tick"):
        runtime.load(path)
