"""Studies on a Dask cluster: a real scheduler, with workers in this process and in processes of their own."""

import pytest

import runtime
from runtime.experiments.studies import cluster
from runtime.experiments.studies.description import read_study
from runtime.host.errors import BadInput
from tests.optional import Library

distributed = Library("distributed")
STUDY = {"diagram": "sine.py", "duration": 0.5, "seeds": [1, 2]}
NOISE = {"function": "rms", "signal": "noise.y"}


@pytest.fixture(scope="module")
def address():
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None, protocol="tcp://"
    ) as local:
        yield local.scheduler_address


def test_table_of_a_cluster_equals_that_of_this_process_bit_for_bit(address, folder):
    pytest.importorskip("pyarrow")
    given = {**STUDY, "grid": {"gain": [1, 2, 3.5]}, "objectives": {"noise": NOISE, "own": "costs_of_test:counted"}}
    runtime.study(**given, workers=0, output="here.parquet")
    runtime.study(**given, dask=address, output="cluster.parquet")
    assert (folder / "here.parquet").read_bytes() == (folder / "cluster.parquet").read_bytes()


def test_exception_on_a_worker_names_trial_and_line(address, folder):
    with pytest.raises(BadInput, match=r"trial 0 \(gain=3, seed=1\): UnknownName: .*costs_of_test.py:\d+"):
        runtime.study(
            **{**STUDY, "seeds": [1]}, grid={"gain": [3]}, objectives={"a": "costs_of_test:raises_once"}, dask=address
        )


def test_worker_imports_a_module_again_that_has_changed_since_the_last_study(address, limb):
    lengths = []
    for length in (0.25, 0.5):
        limb(length)
        objectives = {"length": {"function": "peak", "signal": "length.y"}}
        lengths += runtime.study("limb.py", 0.5, objectives, dask=address)["length"].tolist()
    assert lengths == [0.25, 0.5]


def test_worker_with_another_version_of_tickwork_is_reported(address, folder, monkeypatch):
    releases = iter(["0.2.0", "0.1.0"])  # of this computer, then of the worker, which is in this process
    monkeypatch.setattr(cluster, "_release", lambda: next(releases, "0.1.0"))
    with pytest.raises(BadInput, match=r"the worker has Tickwork 0.1.0, this computer 0.2.0: install the same"):
        runtime.study(**{**STUDY, "seeds": [1]}, objectives={"noise": NOISE}, dask=address)


@pytest.mark.soak
def test_cluster_with_a_killed_worker_gives_the_same_table(folder):
    given = {**STUDY, "seeds": list(range(40)), "objectives": {"noise": NOISE, "once": "costs_of_test:dies_once"}}
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local:
        result = runtime.study(**given, grid={"gain": [3]}, dask=local.scheduler_address)
    assert (folder / "died").exists()
    here = runtime.study(**given, grid={"gain": [3]}, workers=0)
    assert result.columns == here.columns


def test_a_scheduler_without_workers_is_reported(folder, capsys):
    objectives = {"noise": NOISE}
    with distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=":0", protocol="tcp://") as local:
        cluster.Cluster(read_study({**STUDY, "objectives": objectives}), local.scheduler_address).close()
        assert f"the Dask scheduler {local.scheduler_address} has no workers yet" in capsys.readouterr().err
