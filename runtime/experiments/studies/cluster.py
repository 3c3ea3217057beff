"""Engine of a study on a cluster: Dask runs the trials, and runs those of a lost worker again."""

from __future__ import annotations

import os
import sys
from collections.abc import Generator, Iterable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from graph.sha256 import sha256
from runtime.experiments.studies.description import Study, read_study
from runtime.experiments.studies.engine import Engine, Order, failure_text
from runtime.experiments.studies.modules import import_again, is_imported
from runtime.experiments.studies.trial_row import answer
from runtime.host.console.terminal import print_to_stderr
from runtime.host.errors import BadInput
from runtime.host.optional_dependencies import need
from runtime.record.storage.provenance import versions

CONNECT_TIMEOUT = 10.0  # s


class Cluster(Engine):
    """Engine that runs trials on a Dask cluster, and again those of a lost worker.

    study : study with names of the diagram and the objectives, not functions
    address : address of the scheduler, such as "tcp://10.0.0.5:8786"

    Trials wait for the first worker; a line on standard error reports a scheduler without workers.

    Raises BadInput for a scheduler without connection, and for a trial that Dask gives up.
    """

    def __init__(self, study: Study, address: str) -> None:
        self._distributed: Any = need("distributed", "a study on a cluster")
        try:
            self._client = self._distributed.Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
        except (OSError, ValueError) as error:
            raise BadInput(f"no connection to the Dask scheduler {address}: {error}") from None
        if not self._client.nthreads():
            print_to_stderr(
                [f"tickwork: the Dask scheduler {address} has no workers yet; start one: dask worker {address}"]
            )
        self._trial = partial(
            _trial,
            description=replace(study, diagram=os.path.abspath(study.diagram)).content(),
            source=sha256(Path(study.diagram).read_bytes()).hexdigest(),
            sources=study.sources(),
            folder=os.getcwd(),
            release=_release(),
        )

    def run(self, orders: Iterable[Order]) -> Generator[dict[str, Any], None, None]:
        orders = list(orders)
        futures = self._client.map(self._trial, orders, pure=False)
        order_of = dict(zip((future.key for future in futures), orders))
        try:
            ended = self._distributed.as_completed(
                futures, loop=self._client.loop, with_results=True, raise_errors=False
            )
            for future, row in ended:
                if not isinstance(row, dict):  # an exception, or with its type and traceback
                    error = row[1] if isinstance(row, tuple) else row
                    raise BadInput(failure_text(*order_of[future.key], f"{type(error).__name__}: {error}"))
                if "stop" in row:
                    raise BadInput(failure_text(*order_of[future.key], row["stop"]))
                yield row
        finally:
            self._client.cancel(futures)

    def close(self) -> None:
        self._client.close()


@cache
def _release():
    """Return the version of Tickwork; "of a checkout" where it is not installed."""
    return versions().get("tickwork", "of a checkout")


def _trial(order, description, source, sources, folder, release):
    """Run a trial on a worker.

    source : SHA-256 of the diagram file
    sources : {name: SHA-256} of the modules that it and the objectives import
    folder : folder with modules of objectives
    release : version of Tickwork
    """
    if (own := _release()) != release:
        return {"stop": f"the worker has Tickwork {own}, this computer {release}: install the same"}
    try:
        if sha256(Path(description["diagram"]).read_bytes()).hexdigest() != source:
            return {"stop": f"the diagram file {description['diagram']} of the worker is another one"}
    except OSError as error:
        return {"stop": f"the worker cannot read {description['diagram']}: {error.strerror}"}
    if folder not in sys.path:
        sys.path.append(folder)
    if not is_imported(sources):
        own = read_study(description).sources()
        if own != sources:
            names = ", ".join(name for name in sources if own.get(name) != sources[name])
            return {"stop": f"the modules {names} of the worker are others"}
        import_again(sources)
    return answer(description, order)
