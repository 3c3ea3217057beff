"""Process of emulated motors: `python -m tests.bench.motors RATE COUNT DESCRIPTOR...`.

On each socket DESCRIPTOR are COUNT drives with ids from 1 on, held still, at RATE steps per second, until the process
is killed.
"""

import socket
import sys

from blocks.families import benchmark
from cext.bus.socketcan import SocketCan
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, compile
from runtime.host.machine.realtime import Realtime


def main(rate: str, count: str, *descriptors: str) -> None:
    """Emulate motors until killed, and print a line when they are ready.

    rate : steps per second
    count : motors on each bus
    descriptors : file descriptors of one socket per bus
    """
    typical = benchmark("can")
    with Diagram("motors", rate=float(rate)) as motors:
        for bus in range(len(descriptors)):
            for can_id in range(1, int(count) + 1):
                typical.emulator(**typical.parameters, bus=f"bus{bus}", can_id=can_id)(position=0.0, velocity=0.0)
    ends = [SocketCan(socket.socket(fileno=int(descriptor)), shared=True) for descriptor in descriptors]
    executor = Executor(Program(compile(motors), [end.end for end in ends]), float(rate))
    with Realtime("try"):  # a motor is not kept waiting by other programs
        print("ready", flush=True)
        executor.run()


if __name__ == "__main__":
    main(*sys.argv[1:])
