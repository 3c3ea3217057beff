"""Layout for PlotJuggler from a diagram: one tab per subsystem, one plot per unit, and the stream settings.

When the layout is opened, PlotJuggler offers to start the stream and shows the settings of the last stream. A comment
in the file lists the settings to enter once.
(plotjuggler_app/mainwindow.cpp, plotwidget.cpp and plot_docker.cpp of 3.17)
"""

from __future__ import annotations

from ipaddress import ip_address
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as tree

from msgspec.structs import asdict

from blocks.sinks import PlotJuggler
from runtime.record.storage.grouping import by_unit
from runtime.robot.loading.file import compile_diagram, load
from runtime.robot.loading.overrides import Settings
from runtime.robot.loading.signal_selection import select

if TYPE_CHECKING:
    from collections.abc import Sequence

STREAMER, PROTOCOL, TIMESTAMP = "UDP Server", "json", "timestamp"
BUFFER_DURATION = 60  # s of data in PlotJuggler
# (Okabe and Ito 2008)
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442", "#333333")


def columns(
    path: str | Path, settings: Settings = (), rate: float | None = None
) -> tuple[str, float, list[dict[str, Any]], PlotJuggler]:
    """Return (name of the diagram, rate, columns of its PlotJuggler block, that block).

    Without a PlotJuggler block in the diagram the columns are all signals.
    """
    _, diagram = load(path, settings)
    if rate is not None:
        diagram.rate = rate
    if not any(isinstance(block, PlotJuggler) for block in diagram):
        with diagram:
            PlotJuggler()
    schedule = compile_diagram(path, diagram)
    sink = next(sink for sink in schedule.sinks if isinstance(sink.block, PlotJuggler))
    signals = [asdict(column) for column in sink.columns]
    return schedule.name, schedule.rate, [signals[place] for place in select(signals, sink.block.signals)], sink.block


def address(host: str) -> str:
    """Return the IP address on which PlotJuggler must listen to receive what is sent to a host."""
    try:
        return str(ip_address(host))
    except ValueError:
        return "127.0.0.1" if host == "localhost" else "0.0.0.0"


def layout(name: str, signals: Sequence[dict[str, Any]], host: str, port: int) -> str:
    """Return the text of the layout file. signals : columns; host, port : destination of the stream"""
    root, host = tree.Element("root"), address(host)
    comment = (
        f"Tickwork: {name}. Start the stream with: address {host}, port {port}, protocol {PROTOCOL}; "
        f"tick 'use field as timestamp' and enter {TIMESTAMP}. PlotJuggler keeps these settings."
    )
    root.append(tree.Comment(f" {comment.replace('-', '‐')} "))  # two hyphens would end a comment
    tabs = tree.SubElement(root, "tabbed_widget", {"name": "Main Window", "parent": "main_window"})
    for title, plots in by_unit(name, signals).items():
        tab = tree.SubElement(tabs, "Tab", tab_name=title, containers="1")
        container = tree.SubElement(tab, "Container")
        share = ";".join([f"{1.0 / len(plots):.6f}"] * len(plots))
        splitter = tree.SubElement(container, "DockSplitter", orientation="-", count=str(len(plots)), sizes=share)
        for label, paths in plots:
            area = tree.SubElement(splitter, "DockArea", name=label)
            plot = tree.SubElement(
                area, "plot", mode="TimeSeries", style="Lines", line_width="1.5", flip_x="false", flip_y="false"
            )
            tree.SubElement(plot, "limitY")
            for number, path in enumerate(paths):
                tree.SubElement(plot, "curve", name=curve(path), color=COLOURS[number % len(COLOURS)])
    tree.SubElement(tabs, "currentTabIndex", index="0")
    tree.SubElement(root, "use_relative_time_offset", enabled="1")
    tree.SubElement(root, "streaming_buffer_size", value=str(BUFFER_DURATION))
    plugins = tree.SubElement(root, "Plugins")
    tree.SubElement(
        plugins, "plugin", ID=STREAMER, address=host, port=str(port), protocol=PROTOCOL, timestamp=TIMESTAMP
    )
    tree.SubElement(root, "previouslyLoaded_Datafiles")
    tree.SubElement(root, "previouslyLoaded_Streamer", name=STREAMER)
    tree.indent(root)
    return "<?xml version='1.0' encoding='UTF-8'?>\n" + tree.tostring(root, encoding="unicode") + "\n"


def curve(path: str) -> str:
    """Return the name of a signal in PlotJuggler, whose parser joins nested names with slashes."""
    return "/" + path.replace(".", "/")
