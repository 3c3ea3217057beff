"""The average stride of each leg, updated during the recording, and their picture at the end.

Each part of a recording has its own average; `plot --strides` reads all parts.
"""

from __future__ import annotations

import os
from functools import cached_property
from typing import TYPE_CHECKING, Any

from runtime.host.replaced_file import replacement
from runtime.record.analysis.stride_signals import INPUTS, contact_of
from runtime.record.recorder.service import Service
from runtime.record.storage.files import create

if TYPE_CHECKING:
    from runtime.record.analysis.average_stride import AverageStride
    from runtime.record.recorder.plan_types import Plan

BLOCK_ROWS = 1024


class StrideAverage(Service):
    """Serves blocks.recorders.StrideReport: columns phase, walking, angle, velocity, torque, in this order."""

    def open(self) -> None:
        if len(self.sink["columns"]) != len(INPUTS):
            raise ValueError("wire all five inputs: phase, walking, angle, velocity, torque")
        self.columns = [column["index"] for column in self.sink["columns"]]
        sources = {signal["index"]: signal["path"] for signal in self.plan["signals"]}
        self.signals = {name: sources[index] for name, index in zip(INPUTS, self.columns)}
        if contact := contact_of(sources.values(), self.signals["angle"]):
            self.signals["contact"] = contact
            self.columns += [index for index, source in sources.items() if source == contact]
        path = self.sink["path"]
        self.title = self.sink["parameters"].get("title") or path.rpartition("/")[0] or path
        self.rows = []

    @cached_property
    def average(self) -> AverageStride:
        """The average. Its first use imports NumPy, which takes 0.1 s: after the files are open."""
        from runtime.record.analysis.average_stride import AverageStride

        return AverageStride(self.plan["rate"])

    def begin(self, about: dict[str, Any]) -> None:
        self.average  # noqa: B018

    def records(self, batch: Any) -> None:
        if batch.rows:
            self.rows += batch.table(float(self.plan["rate"]), self.columns, [False] * len(self.columns))
            if len(self.rows) >= BLOCK_ROWS:
                self.add_rows()

    def add_rows(self) -> None:
        """Add the rows that have arrived to the average."""
        import numpy as np

        rows = np.array(self.rows, dtype=float).reshape(-1, 2 + len(self.columns))
        self.average.add(rows[:, 1].astype(np.int64), rows[:, 2:])
        self.rows.clear()

    def close(self) -> dict[str, Any]:
        self.add_rows()
        positive = str(self.sink["parameters"].get("positive") or "")
        about = {"title": self.title, "path": self.sink["path"], "positive": positive, "signals": self.signals}
        self.result = about | self.average.result()
        summary, part = {key: self.result[key] for key in ("strides", "left_out")}, self.plan.get("part", 1)
        return summary | (
            {"problem": f"{self.title}: the average does not include strides before part {part}"} if part > 1 else {}
        )

    @classmethod
    def conclude(cls, plan: Plan, services: list[Any]) -> dict[str, Any]:
        """Reserve one picture of all legs, which `later` draws after the report of the run.

        Returns `strides` for the report: a dict per leg in s, N·m, J, rad and W. A run that a signal has ended has no
        picture; `plot --strides` draws the same.
        """
        results = [service.result for service in services]
        walked = [result for result in results if result["strides"]]
        if not walked or plan["folder"] is None or plan.get("stopped"):
            return {"strides": results}
        path, descriptor = create(os.path.join(plan["folder"], plan["stem"]), ".png")
        os.close(descriptor)

        def draw():
            from runtime.record.analysis import stride_picture  # imports matplotlib

            try:
                with replacement(path) as file:
                    about = stride_picture.about_legs(plan["name"], walked)
                    stride_picture.draw(stride_picture.by_joint(walked), about, file)
            except BaseException:
                os.unlink(path)
                raise

        note = "the average stride of " + ", ".join(each["title"] for each in walked)
        return {"strides": results, "files": {path: note}, "later": draw}


SERVICE = StrideAverage
