"""Time a tick of Tickwork beside the same diagram by hand and in other frameworks: `python -m tests.peers`.

The frameworks are those that are installed: `pip install --group peers`. Each contender is first checked against one
reference. All are timed in turn, in processor time of one thread.
"""

import argparse
import importlib

from runtime.setup.bench.measure import interleave, table
from runtime.setup.bench.report import machine_lines
from tests.bench import can_cost
from tests.bench.c_program import NoCompiler
from tests.peers import netlists, python_can, reading, recording, study
from tests.peers.agreement import check
from tests.peers.by_hand import PlainPython, StraightC
from tests.peers.tickwork import CalledBlocks, NativeBlocks, PythonBlocks

DIAGRAMS = {"knee": netlists.knee, "wide": netlists.wide, "wide6": netlists.wide6, "chain": netlists.chain}
OURS = (NativeBlocks, CalledBlocks, PythonBlocks)
PEERS = {"drake": ("DrakeCpp", "DrakePython"), "pathsim": ("PathSim",), "bdsim": ("Bdsim",)}  # {module: contenders}


def contenders_of(netlist, with_peers=True):
    """Make every contender for a netlist that this machine can run, and check it.

    Returns (contenders, {name: reason} of those left out).
    """
    reference = PlainPython(netlist)
    contenders, left_out = [*(kind(netlist) for kind in OURS), reference], {}
    try:
        contenders.append(StraightC(netlist))
    except NoCompiler as error:
        left_out[StraightC.name] = str(error)
    for contender in contenders:
        check(contender, reference)
    for module, names in PEERS.items() if with_peers else ():
        try:
            peers = importlib.import_module(f"tests.peers.{module}")
        except ImportError as error:
            left_out[module] = f"not installed: {error}"
            continue
        for name in names:
            try:
                contender = getattr(peers, name)(netlist)
                check(contender, reference)
                contenders.append(contender)
            except Exception as error:  # another version of the framework may raise anything
                left_out[name] = f"{type(error).__name__}: {error}"
    return contenders, left_out


def time_diagram(netlist, seconds, repeats):
    contenders, left_out = contenders_of(netlist, netlist.name != "chain")
    times = interleave(contenders, seconds, repeats)
    heading, lines, _ = table(times, dict.fromkeys(times, netlist.blocks), NativeBlocks.name)
    width = f" of {netlist.width} elements" if netlist.width > 1 else ""
    print("", f"{f'{netlist.name}: {netlist.blocks} blocks{width}':38}{heading}", *lines, sep="\n")
    for name, reason in left_out.items():
        print(f"  {name:36}left out: {reason}")


def time_drives(ticks=400):
    """Print what a tick of eight drives costs over a socket, here and in a program on python-can."""
    _, through, _ = can_cost.native(10 * ticks)
    rows = {"Tickwork, native blocks": [ns * 1e-3 for ns in through], "python-can": python_can.measure(ticks)}
    print(
        "", f"{f'{can_cost.DRIVES} drives over a socket':38}{'µs per tick: min':>16}{'median':>12}{'max':>12}", sep="\n"
    )
    for name, times in rows.items():
        times = sorted(times)
        print(f"  {name:36}{times[0]:16.4g}{times[len(times) // 2]:12.4g}{times[-1]:12.4g}")


def time_recording(ticks=20_000):
    """Print what a tick costs the recorder, and other writers of the same rows."""
    print("", f"{'36 signals and 4 frames into files':38}{'µs per tick':>16}", sep="\n")
    for name, microseconds in recording.measure(ticks).items():
        print(f"  {name:36}{microseconds:16.4g}")


OTHERS = {"can": time_drives, "recording": time_recording, "reading": reading.print_times, "study": study.print_times}
PARTS = (*DIAGRAMS, *OTHERS)


def main():
    parser = argparse.ArgumentParser(prog="python -m tests.peers", description=__doc__.partition("\n")[0])
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)} (default: all)")
    parser.add_argument("--seconds", type=float, default=0.05, help="duration of each measurement")
    parser.add_argument("--repeats", type=int, default=15, help="measurements of each row, taken in turn")
    options = parser.parse_args()
    if unknown := set(options.parts) - set(PARTS):
        parser.error(f"unknown part {unknown.pop()!r}")
    print(*machine_lines(), sep="\n")
    for part in options.parts or PARTS:
        if part in OTHERS:
            OTHERS[part]()
        else:
            time_diagram(DIAGRAMS[part](), options.seconds, options.repeats)


if __name__ == "__main__":
    main()
