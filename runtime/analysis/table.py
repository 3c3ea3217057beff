"""A recording as a pandas DataFrame."""

from runtime.base.optional_dependencies import need


def table(trial):
    """Return the DataFrame that Trial.table describes. Raises MissingExtra."""
    pandas = need("pandas", "a table")
    columns = {"tick": trial.tick, **{path: trial[path] for path in trial.signals}}
    made = pandas.DataFrame(columns, index=pandas.Index(trial.time, name="time"))
    made.attrs.update(units={path: entry["unit"] for path, entry in trial.signals.items()}, fields=trial.fields)
    return made
