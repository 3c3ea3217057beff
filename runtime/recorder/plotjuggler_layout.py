"""A layout for PlotJuggler, made from a diagram: a tab a subsystem, a plot a unit, and the stream's settings.

PlotJuggler asks whether to start the stream when the layout is opened, and shows its settings with what it had last
time, so that they stand in the file for who opens it: a comment says what to enter, once.
(plotjuggler_app/mainwindow.cpp, plotwidget.cpp and plot_docker.cpp of 3.17)
"""

from ipaddress import ip_address
from xml.etree import ElementTree as tree

from blocks.sinks import PlotJuggler
from runtime.diagrams.file import compiled, load
from runtime.recording.grouping import by_unit
from runtime.recording.signal_selection import chosen

STREAMER, PROTOCOL, STAMP = "UDP Server", "json", "timestamp"
BUFFER = 60  # s that PlotJuggler keeps
# (Okabe and Ito 2008)
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442", "#333333")


def columns(path, settings=(), rate=None):
    """(name of the diagram, its rate, what its PlotJuggler block takes, that block): of a diagram file; all signals
    where it has no such block.
    """
    _, diagram = load(path, settings)
    if rate is not None:
        diagram.rate = rate
    if not any(isinstance(block, PlotJuggler) for block in diagram):
        with diagram:
            PlotJuggler()
    schedule = compiled(path, diagram)
    found = next(sink for sink in schedule.sinks if isinstance(sink.block, PlotJuggler))
    signals = [vars(column) for column in found.columns]
    return schedule.name, schedule.rate, [signals[place] for place in chosen(signals, found.block.signals)], found.block


def address(host):
    """What PlotJuggler has to listen on so that it hears what is sent to a host: it takes numbers alone."""
    try:
        return str(ip_address(host))
    except ValueError:
        return "127.0.0.1" if host == "localhost" else "0.0.0.0"


def layout(name, signals, host, port):
    """The file's text. signals : columns; host, port : that is sent to"""
    root, host = tree.Element("root"), address(host)
    words = (
        f"Tickwork: {name}. Start the stream with: address {host}, port {port}, protocol {PROTOCOL}; "
        f"tick 'use field as timestamp' and enter {STAMP}. PlotJuggler keeps that."
    )
    root.append(tree.Comment(f" {words.replace('-', '‐')} "))  # two hyphens would end a comment
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
    tree.SubElement(root, "streaming_buffer_size", value=str(BUFFER))
    plugins = tree.SubElement(root, "Plugins")
    tree.SubElement(plugins, "plugin", ID=STREAMER, address=host, port=str(port), protocol=PROTOCOL, timestamp=STAMP)
    tree.SubElement(root, "previouslyLoaded_Datafiles")
    tree.SubElement(root, "previouslyLoaded_Streamer", name=STREAMER)
    tree.indent(root)
    return "<?xml version='1.0' encoding='UTF-8'?>\n" + tree.tostring(root, encoding="unicode") + "\n"


def curve(path):
    """What PlotJuggler calls a signal: its own parser makes a path of nested names."""
    return "/" + path.replace(".", "/")
