"""Patterns of parameters: `*/profile.scale` is that parameter of every leg."""

from fnmatch import fnmatchcase

from runtime.base.suggestions import suggestion


def is_pattern(name):
    return any(character in name for character in "*?[")


def matching(name, known):
    """The names that a name or pattern stands for, in the order of `known`; `*` stands for any characters, "/"
    included.
    """
    return (
        [other for other in known if fnmatchcase(other, name)]
        if is_pattern(name)
        else [other for other in known if other == name]
    )


def hint(name, known):
    """'did you mean ...?' for a name or pattern that matches nothing, or ''."""
    return suggestion(name, [*known, *shared(known)] if is_pattern(name) else known)


def shared(known):
    """{pattern: names} of what several parts of a diagram have alike: `*/profile.scale` of left/profile.scale and
    right/profile.scale.
    """
    groups = {}
    for name in known:
        part, slash, rest = name.partition("/")
        if slash:
            groups.setdefault(f"*/{rest}", []).append(name)
    return {pattern: names for pattern, names in groups.items() if len(names) > 1}
