"""The optimiser process: a companion of the run that carries out a Protocol (see runtime.record.recorder.companion).

It proposes and measures, and stores the state. The run, its keys and its stop depend on other processes. It ends with
the run; if it dies before, the recorder restores the last accepted parameters.
"""

from __future__ import annotations

import json
import os
import select
import socket
import time
from contextlib import suppress
from typing import Any

from cext.memory.shared_state import SharedState
from cext.safety.thresholds import CONSENT_LIMIT
from runtime.experiments.optimisation.cart import open_cart
from runtime.experiments.optimisation.costs import CartCost, Cost, SignalCost, Typed
from runtime.experiments.optimisation.live_robot import LiveRobot, Targets
from runtime.experiments.optimisation.metabolic import Estimate
from runtime.experiments.optimisation.optimisers import Optimiser, restore_optimiser
from runtime.experiments.optimisation.planner import expectation
from runtime.experiments.optimisation.protocol import BACKSPACE, HELP, NUMERALS, Protocol, Settings
from runtime.experiments.optimisation.state_file import StateFile
from runtime.host.child_process import ChildProcess
from runtime.host.ending import ignore_signals
from runtime.host.errors import BadInput
from runtime.host.live import table
from runtime.record.recorder.companion import MESSAGE_LIMIT

ORDERS_DESCRIPTOR = 0  # standard input
READY_TIMEOUT = 60.0  # s, for the imports of an optimiser
POLL_PERIOD = 50  # ms
REFRESH_PERIOD = 1.0  # s, after which the needs are sent again
STATUS_PERIOD = 0.25  # s
END_TIMEOUT = 2.0  # s for the process to end after the run
NICENESS = 10
ENDED = ("stopping", "safe")  # states of a run that is ending
KEYS = ["y", "n", "p", "r"]
STALE = -1  # question of a key that was pressed too long ago


class OptimiserProcess(ChildProcess):
    """The optimiser process of one run. Spawned at once; the constructor returns once it is ready.

    shared : shared state of the run
    channel : file descriptor of its connection to the recorder
    plan : dict for JSON: state, cost, zero, generations, settings, and noises, the standard deviations of a measurement
        relative to the cost for which the protocol is simulated before

    Raises BadInput if it cannot start: the optimiser's package is missing, the cart cannot be opened.
    """

    def __init__(self, shared: SharedState, channel: int, plan: dict[str, Any]) -> None:
        super().__init__("runtime.experiments.optimisation.process", (shared.fd, channel), (shared.fd, channel))
        answer = None
        with suppress(BrokenPipeError, TimeoutError):
            self._send(json.dumps(plan).encode() + b"\n")
            answer = self._answer(READY_TIMEOUT)
        if answer is None or "error" in answer:
            self.end()
            raise BadInput(answer["error"] if answer else "the optimiser process ended before it was ready")

    def begin(self, path: str) -> None:
        """Begin the optimisation once the robot runs. path : path of the state file"""
        with suppress(BrokenPipeError):  # the recorder reports it
            self._send(path.encode() + b"\n")


def main(answers: int, control: int, shared: int, channel: int) -> None:
    """Run the optimiser process.

    answers : file descriptor of the pipe to the control process
    control : pidfd of the control process
    shared : file descriptor of the shared state
    channel : file descriptor of the connection to the recorder
    """
    ignore_signals()
    os.nice(NICENESS)
    with open(ORDERS_DESCRIPTOR) as orders:
        plan = json.loads(orders.readline() or "null")
        if plan is None:
            return
        try:
            optimiser = restore_optimiser(plan["state"]["optimiser"])
            cost = cost_of(plan["cost"])
        except BadInput as error:
            answer(answers, {"error": str(error)})
            return
        answer(answers, {"ready": True})
        path = orders.readline().rstrip("\n")
    if not path:  # the run has ended before it began
        return
    Companion(SharedState(fd=shared), control, channel, plan, optimiser, cost, path).run()


def answer(descriptor: int, message: dict[str, Any]) -> None:
    """Send one line of JSON to the control process."""
    with suppress(BrokenPipeError):
        os.write(descriptor, json.dumps(message).encode() + b"\n")


def cost_of(plan: dict[str, Any]) -> Cost:
    """Return the Cost of its part of the plan. Raises BadInput."""
    if plan["kind"] == "typed":
        return Typed()
    if plan["kind"] == "signal":
        return SignalCost(plan["name"], plan["unit"], plan["time_constant"], len(plan["columns"]) > 1)
    cart = open_cart(plan["name"])
    cart.take(time.monotonic())  # a header that is wrong is reported before the run
    return CartCost(cart, plan["time_constant"])


class Companion:
    """The optimiser's end of the connection, and its Protocol.

    shared : shared state of the run
    control : pidfd of the control process
    channel : file descriptor of the connection to the recorder
    plan : as in OptimiserProcess
    path : path of the state file
    """

    def __init__(
        self,
        shared: SharedState,
        control: int,
        channel: int,
        plan: dict[str, Any],
        optimiser: Optimiser,
        cost: Cost,
        path: str,
    ) -> None:
        self.shared, self.control, self.plan = shared, control, plan
        self.channel, self.cost = socket.socket(fileno=channel), cost
        self.poll = select.poll()
        self.poll.register(control, select.POLLIN)
        self.poll.register(channel, select.POLLIN)
        self.watch = plan["cost"].get("columns", [])
        self.sent, self.due = {}, 0.0
        self.over, self.changing = False, False
        zero = [tuple(pair) for pair in plan["zero"]]
        self.robot = LiveRobot(shared, Targets(table.read(shared), optimiser.parameters, zero), self.announce)
        self.file = StateFile(path, plan["state"])
        self.protocol = Protocol(
            optimiser,
            self.robot,
            cost,
            Settings.of(plan, optimiser.population),
            self.report,
            self.save,
            plan["state"]["accepted"],
            [(name, Estimate(*numbers)) for name, numbers in plan["state"]["validated"]],
        )

    def run(self) -> None:
        """Carry out the optimisation until the end of the run."""
        self.save()
        self.protocol.expectation = expectation(self.plan)  # takes seconds
        while not self.ending():
            self.receive()
            if self.ending():  # meanwhile: not a missing measurement
                return
            self.protocol.step(time.monotonic())
            self.send_needs()

    def ending(self) -> bool:
        """Return whether the run, its control process or its recorder is ending or has ended."""
        return self.over or self.shared.closed or self.shared.state in ENDED

    def receive(self) -> None:
        """Wait for messages of the recorder, and for the end of the run."""
        for descriptor, _ in self.poll.poll(POLL_PERIOD):
            if descriptor == self.control:
                self.over = True
                continue
            try:
                message = self.channel.recv(MESSAGE_LIMIT)
            except OSError:
                message = b""
            if not message:  # no recorder: the evaluations would not be recorded
                self.over = True
                with suppress(Exception):
                    self.robot.apply(self.protocol.accepted, False)
                return
            self.take(json.loads(message))

    def take(self, message: dict[str, Any]) -> None:
        """Take a message of the recorder."""
        if "key" in message:
            age = time.monotonic_ns() - message.get("read", time.monotonic_ns())
            self.protocol.press(message["key"], message.get("question") if age <= CONSENT_LIMIT else STALE)
        if isinstance(self.cost, SignalCost):
            origin = (self.shared.began + self.shared.first_tick) * 1e-9
            for seconds, *values in message.get("rows", ()):
                self.cost.add(origin + seconds, *values)

    def announce(self) -> None:
        """Send the parameters that the recorder restores if this process dies, before they are changed."""
        self.changing = True
        self.send_needs()

    def send_needs(self) -> None:
        """Send the display and the orders for the recorder, where they have changed."""
        now = time.monotonic()
        active = not self.protocol.over
        fallback, complete = self.robot.fallback(self.protocol.accepted) if self.changing and active else ([], True)
        keys = [*KEYS, *NUMERALS, *BACKSPACE, "enter"] if self.protocol.typing else KEYS
        needs = {
            "keys": keys if active else [],
            "help": HELP if active else "",
            "watch": self.watch,
            "fallback": fallback,
            "partial": not complete,
            "status": self.protocol.status,
            "question": self.protocol.question,
        }
        if needs != self.sent or now >= self.due:
            self.sent, self.due = needs, now + REFRESH_PERIOD
            self.send(needs)

    def report(self, step: str, lines: list[str], **fields: Any) -> None:
        """Send an event for the recording."""
        fields = {name: None if value != value else value for name, value in fields.items()}  # NaN is not JSON
        event = {"event": "optimise", "step": step, "tick": self.robot.tick, **fields}
        self.send({"event": event | ({"lines": lines} if lines else {})})

    def send(self, message: dict[str, Any]) -> None:
        """Send a message to the recorder."""
        with suppress(OSError):
            self.channel.send(json.dumps(message).encode(), socket.MSG_NOSIGNAL)

    def save(self) -> None:
        """Store the state."""
        try:
            self.file.save(self.protocol)
        except OSError as error:
            self.report("unsaved", [f"tickwork: cannot write {self.file.path}: {error.strerror}"])
