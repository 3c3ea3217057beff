"""A recording as a pandas DataFrame."""

from __future__ import annotations

from typing import TYPE_CHECKING

from runtime.host.optional_dependencies import need

if TYPE_CHECKING:
    import pandas

    from runtime.record.analysis.trial_data import TrialData


def table(trial: TrialData) -> pandas.DataFrame:
    """Return the DataFrame that Trial.table describes. Raises MissingExtra."""
    pandas = need("pandas", "a table")
    signals = trial.read(trial.signals)
    signals |= {path: trial.column(path) for path in trial.signals if trial.every(path) > 1}
    columns = {"tick": trial.tick, **signals}
    made = pandas.DataFrame(columns, index=pandas.Index(trial.time, name="time"))
    made.attrs.update(units={path: entry["unit"] for path, entry in trial.signals.items()}, fields=trial.fields)
    made.attrs.update(complete=trial.complete, trouble=trial.trouble)
    return made
