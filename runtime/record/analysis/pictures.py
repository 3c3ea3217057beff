"""Pictures of recordings: signals over time, and over the gait cycle."""

from __future__ import annotations

import base64
import html
import io
import os
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from runtime.host.errors import BadInput
from runtime.host.optional_dependencies import need
from runtime.host.replaced_file import replacement

if TYPE_CHECKING:
    from runtime.record.analysis.conditions import Condition
    from runtime.record.analysis.trial_data import TrialData

Draw = Callable[[BinaryIO, str], Any]  # into a file, as "png", "svg" or "pdf"
ENDINGS = (".png", ".svg", ".pdf")


class Pictures:
    """Pictures that a notebook shows, one below the other.

    draws : {title: function that draws into a file}
    """

    def __init__(self, draws: dict[str, Draw]) -> None:
        self.draws = draws

    def save(self, path: str | os.PathLike[str]) -> list[Path]:
        """Write the pictures as .png, .svg or .pdf. Several get their title in the name. Returns the paths.

        Raises BadInput for another ending.
        """
        target = Path(path)
        check_ending(target, str(target))
        paths = []
        for title, draw in self.draws.items():
            stem = target.stem if len(self.draws) == 1 else f"{target.stem}_{file_name(title)}"
            paths.append(target.with_name(stem + target.suffix))
            with replacement(paths[-1]) as file:
                draw(file, target.suffix[1:])
        return paths

    def html(self) -> str:
        """Return the pictures as HTML, which contains them."""
        return "".join(
            f'<img alt="{html.escape(title)}" style="max-width: 100%" src="data:image/png;base64,{picture}">'
            for title, picture in ((title, in_base64(draw)) for title, draw in self.draws.items())
        )

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, str]:
        """Return one picture as PNG, which a viewer without HTML and an exported PDF show too, or several as HTML."""
        if len(self.draws) == 1:
            [draw] = self.draws.values()
            return {"image/png": in_base64(draw)}
        return {"text/html": self.html()}

    def __repr__(self) -> str:
        return f"<Pictures: {', '.join(self.draws)}; save('NAME.png') writes them>"


def check_ending(path: Path, text: str) -> None:
    """Raise BadInput, which begins with `text`, for a path that does not end as a picture."""
    if path.suffix not in ENDINGS:
        raise BadInput(f"{text}: the name of a picture must end in {', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}")


def file_name(title: str) -> str:
    """Return a title without the characters that the name of a file should not have."""
    return re.sub(r"[^\w.-]+", "_", title)


def in_base64(draw: Draw) -> str:
    """Return a picture as PNG in base64."""
    file = io.BytesIO()
    draw(file, "png")
    return base64.b64encode(file.getvalue()).decode()


def over_time(trials: Sequence[TrialData], names: Sequence[str] = ()) -> dict[str, Draw]:
    """Return {title: function that draws} of signals over time.

    trials : one, or several to be drawn over each other, a plot for each signal
    names : signals, blocks or subsystems, in one picture; by default a picture for each subsystem, and of several
        trials the angle and the torque of each actuator

    Raises KeyError, or BadInput for a trial without ticks.
    """
    need("matplotlib.figure", "a picture")
    from runtime.record.analysis import plots
    from runtime.record.analysis.conditions import trial_labels

    for trial in trials:
        if not len(trial):
            raise BadInput(f"{trial.path} contains no ticks")
    trial, heading = trials[0], trials[0].path.stem
    labelled = dict(zip(trial_labels(trials), trials))
    if len(trials) > 1:
        rows = plots.rows_over_each_other(trials, names)
        return {"plot": partial(plots.over_time, labelled, rows, " over ".join(labelled))}
    if names:
        return {"plot": partial(plots.over_time, labelled, plots.rows_of(trial, names), heading)}
    figures = {}
    for title, (rows, share) in plots.overview(trial).items():
        text = f"{heading}: {title}" + f", {share}" * bool(share)
        figures[title] = partial(plots.over_time, labelled, rows, text, subsystem=title)
    return figures


def over_strides(
    conditions: Sequence[Condition], names: Sequence[str] = (), width: float | None = None
) -> dict[str, Draw]:
    """Return {"strides": function that draws} of conditions over the gait cycle.

    names : signals, blocks or subsystems; by default angle, torque and power of each joint
    width : mm; one or two columns of a journal by default

    Raises KeyError or BadInput.
    """
    need("matplotlib.figure", "a picture")
    from runtime.record.analysis import stride_picture
    from runtime.record.analysis.legs import legs
    from runtime.record.analysis.plots import PLOT_LIMIT, alone

    first = conditions[0]
    if names:
        paths = [path for name in names for path in alone(first.trial, name)]
        if len(paths) > PLOT_LIMIT:
            raise BadInput(f"{len(paths)} signals need as many plots, more than {PLOT_LIMIT}: select fewer")
        columns, about = stride_picture.of_signals(conditions, paths), ", ".join(paths)
    elif len(conditions) > 1 or first.mass is not None:
        columns, about = stride_picture.by_leg(conditions), stride_picture.about_conditions(conditions)
    else:
        both_legs = legs(first.trial, first.events, first.between, first.last)
        columns = stride_picture.by_joint(both_legs)
        about = stride_picture.about_legs(first.trial.about["name"], both_legs)
    return {"strides": lambda file, kind: stride_picture.draw(columns, about, file, kind, width)}
