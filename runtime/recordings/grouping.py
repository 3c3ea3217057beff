"""Which signals a person wants to see together: those of a subsystem, a plot a unit."""

from runtime.recordings.messages import split

PLOTS, CURVES = 6, 12           # of a subsystem; of a plot
FIRST = ("rad", "N·m", "rad/s", "m/s²", "A", "1")      # units that come first, in this order
PLAIN = ("1", "any")


def by_unit(name, signals):
    """{subsystem: [(title of a plot, [path])]}, in the order of the signals.

    name : of the diagram, for what is in no subsystem; signals : [{"path", "unit"}]
    """
    found = {}
    for signal in signals:
        folder, _, _ = split(signal["path"])
        found.setdefault(folder or name, {}).setdefault(signal["unit"], []).append(signal["path"])
    groups = {}
    for title, units in found.items():
        order = sorted(units, key=lambda unit: FIRST.index(unit) if unit in FIRST else len(FIRST))
        groups[title] = [(f"{title} [{unit}]" if unit not in PLAIN else title, units[unit][:CURVES]) for unit in order[:PLOTS]]
    return groups
