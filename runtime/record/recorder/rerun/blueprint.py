"""Layout of the viewer: one plot per subsystem and unit, the limbs in 3-D, and the events."""

from __future__ import annotations

from typing import Any

from runtime.record.recorder.rerun.scene import Scene

EVENTS = ("events",)
SPACE = ("space",)


def blueprint(scene: Scene) -> Any:
    """Return the rerun.blueprint.Blueprint of a Scene."""
    import rerun as rr
    import rerun.blueprint as rrb

    plots = [
        rrb.TimeSeriesView(
            origin="/",
            name=plot.title,
            contents=[
                rr.new_entity_path(list(plot.entity)),
                *([rr.new_entity_path([*plot.entity, "limits"])] if plot.limits else []),
            ],
            plot_legend=rrb.PlotLegend(visible=True),
        )
        for plot in scene.plots
        if any(plot.shown)
    ]
    beside = (
        [
            rrb.Spatial3DView(
                origin=rr.new_entity_path(list(SPACE)),
                name="limbs",
                eye_controls=rrb.EyeControls3D(position=(1.05, -1.2, 0.75), look_target=(0.0, 0.0, 0.52)),
            )
        ]
        if scene.limbs or scene.sensors
        else []
    )
    log = rrb.TextLogView(origin=rr.new_entity_path(list(EVENTS)), name="faults and events")
    shown = rrb.Grid(*plots, grid_columns=1 if len(plots) < 4 else 2)
    if beside:
        whole = rrb.Horizontal(shown, rrb.Vertical(*beside, log, row_shares=[3, 1]), column_shares=[3, 2])
    else:
        whole = rrb.Vertical(shown, log, row_shares=[5, 1])
    return rrb.Blueprint(
        whole,
        rrb.TimePanel(state="collapsed", timeline="time"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )
