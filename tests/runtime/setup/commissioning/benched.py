"""A robot on a bench: emulated drives with faults, joints that a scripted hand turns, and the operator at a terminal.

`emulate` plays the drives in one process, `commission` runs on a pseudo terminal in another. The hand is a file that
the plant reads: where it holds each joint, or the lever that hangs from it.
"""

import json
import os
import re
import signal
import time

import can

from tests.runtime.runs import started, write
from tests.runtime.setup.commissioning.nodes import V3, Mit, Node, Nodes, Private, Servo, channel
from tests.runtime.terminals import Terminal

LENGTH = 0.2  # m of the lever
TWINS = {"CubeMars": Mit, "CubeMarsServo": Servo, "CubeMarsV3": V3, "RobStride": Private}
ROBOT = '''
import json, math, os
from blocks.actuators import *
from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, RobStride, RobStrideMIT
from blocks.sensors import AS5047, AS5600
from graph import Block, Diagram, Input, Output, Param, subsystem

DRIVES = {drives!r}
FOLDER = {folder!r}


class Arm(Block):
    """Joint that a hand holds, from which a lever hangs, or that has a lower stop."""

    noise = Param(0.0, "rad")
    friction = Param(0.0, "N·m", "Coulomb friction while a lever hangs from it")
    torque = Input("N·m")
    position = Output("rad")
    velocity = Output("rad/s")
    encoder = Output("rad", "angle of its encoder, whose magnet slips when the joint is turned")
    slip = Param(0.0, "rad")

    def reset(self):
        self.slipped = 0.0
        self.at, self.speed, self.hand, self.most, self.shown = 0.0, 0.0, {{"hold": 0.0}}, 0.0, 0.0

    def step(self, tick):
        self.slipped = self.slip if self.at > 0.4 else self.slipped
        return self.at + self.noise * math.sin(1.7 * tick), self.speed, self.at + self.slipped

    def held(self, friction):
        return 500.0 * min(0.0, self.at - self.hand["stop"]) + friction * math.tanh(50.0 * self.speed)

    def update(self, torque, tick):
        if tick % 20 == 0:
            try:
                self.hand = json.load(open(FOLDER + "/hand.json")).get(self.path, self.hand)
            except (OSError, ValueError):
                pass
        if "hold" in self.hand:
            left = self.hand["hold"] - self.at
            wanted = math.copysign(min(1.5 + 0.4 * math.sin(0.02 * tick), 8.0 * abs(left)), left)
            self.speed += max(-0.02, min(0.02, wanted - self.speed))
        else:
            lever, inertia = self.hand.get("lever", 0.4), self.hand["inertia"]
            pull = lever * math.sin(self.at) if "lever" in self.hand else self.held(0.05)
            free = self.speed + (torque - pull - 0.15 * math.sqrt(lever * inertia) * self.speed) / inertia * self.dt
            self.speed = math.copysign(max(0.0, abs(free) - self.friction * self.dt / inertia), free)
        self.at += self.speed * self.dt
        if abs(torque) > self.most:
            self.most = abs(torque)
        if self.most > 1.01 * self.shown:
            self.shown = self.most
            with open(FOLDER + "/torque_" + self.path, "w") as file:
                file.write(str(self.most))


class Plug(Block):
    """Plug that has no contact for a part of each second."""

    part = Param(0.15, "1")
    open = Output("1")

    def step(self, t):
        return float(t % 1.0 < self.part)


def build():
    with Diagram("bench", rate=200) as diagram:
        for name, (kind, model, can_id, faults, settings) in DRIVES.items():
            if "encoder" in faults:
                globals()[faults["encoder"][0]]("chips", name=name + "_encoder")
            block = globals()[kind](model, bus="legs", can_id=can_id, name=name, range=(-6.0, 6.0), **settings)
            block(**{{next(each for each in block.inputs if each in ("torque_command", "current_command")): 0.0}})
    return diagram


def plant(robot):
    with Diagram("bench_plant", rate=1000) as plant:
        for name, (_, _, _, faults, _) in DRIVES.items():
            faults = dict(faults)
            kind, inputs = faults.pop("kind", None), faults.pop("inputs", {{}})
            moved, velocity = faults.pop("moved_by", name), faults.pop("velocity", 1.0)
            shown, bias = faults.pop("position", 1.0), faults.pop("bias", 0.0)
            own = {{each: faults.pop(each) for each in ("noise", "friction") if each in faults}}
            part = faults.pop("plug", 0.0)
            drive, encoder = robot[name], faults.pop("encoder", None)
            with subsystem(name):
                for other in ("twin", "ground", "end"):
                    faults.pop(other, None)
                if faults.pop("absent", False):
                    continue
                if kind:
                    model = faults.pop("other", drive.model)
                    emulated = globals()["Emulated" + kind](model, bus="legs", can_id=drive.can_id, **faults)
                else:
                    emulated = drive.emulator(**faults)
            arm = Arm(**own, slip=encoder[1] if encoder else 0.0, name=moved)(emulated.torque)
            if encoder is not None:
                robot[name + "_encoder"].emulator()(position=arm.encoder)
            if part:
                inputs["dropped"] = Plug(part=part, name="plug_of_" + name)()
            emulated(position=shown * arm.position, velocity=velocity * arm.velocity + bias, **inputs)
    return plant
'''


CHIPS = '[bus.chips]\ninterface = "{}"\nchannel = "unix:/tmp/chips{}"\n'  # the path of a socket is short


class ErrorFrames(Node):
    """Node that destroys frames, as a bus without a common ground does."""

    period = 0.02

    def speak(self):
        self.bus.send(can.Message(is_error_frame=True, arbitration_id=0x80, data=bytes(8)))
        return []


class Benched:
    """Emulated drives and the rig file. drives : {name: (block, model, id, faults, settings)}

    set_timeout : s, that the operator sets in the drives when `commission` asks for it; 0: the operator does not
    """

    set_timeout = 0.0

    def __init__(self, folder, number, drives):
        self.folder, self.drives, self.channel = folder, drives, channel(number)
        self.robot = write(folder, ROBOT.format(drives=drives, folder=str(folder)))
        self.rig = write(
            folder,
            f'[bus.legs]\ninterface = "udp_multicast"\nchannel = "{self.channel}"\n'
            + "".join(
                CHIPS.format({"AS5600": "i2c", "AS5047": "spi"}[faults["encoder"][0]], os.getpid())
                for _, _, _, faults, _ in drives.values()
                if "encoder" in faults
            ),
            "lab.toml",
        )
        self.hand = {name: {"hold": 0.0} for name in drives}
        self.move({})
        twins: list = [TWINS[kind](can_id) for kind, _, can_id, faults, _ in drives.values() if "twin" in faults]
        twins += [ErrorFrames()] * any("ground" in faults for _, _, _, faults, _ in drives.values())
        self.twins = Nodes(number, *twins)

    def __enter__(self):
        self.twins.__enter__()
        self.emulate()
        return self

    def emulate(self):
        """Start the emulated drives."""
        self.plant = started("emulate", self.robot, "--rig", self.rig, cwd=self.folder)
        lines = []
        while not lines or "Ctrl-C ends it" not in lines[-1]:
            lines.append(self.plant.stdout.readline())
            assert lines[-1], lines + self.plant.stderr.readlines()

    def restart(self):
        """Restart the emulated drives with `set_timeout`, as an operator sets it with the vendor's tool."""
        self.plant.kill()
        self.plant.communicate()
        for *_, faults, _ in self.drives.values():
            faults["command_timeout"] = self.set_timeout
        write(self.folder, ROBOT.format(drives=self.drives, folder=str(self.folder)))
        self.emulate()

    def __exit__(self, *exception):
        self.twins.__exit__()
        self.plant.kill()
        self.plant.communicate()

    def move(self, changed):
        """Let the hand hold joints, hang levers or release them.

        changed : {name: {"hold": rad}, {"lever": N·m, "inertia": kg·m²} or {"stop": rad, "inertia": kg·m²}}
        """
        self.hand |= changed
        new = self.folder / "hand.new"
        new.write_text(json.dumps(self.hand))
        os.replace(new, self.folder / "hand.json")

    def torque(self, name):
        """Largest torque of a drive so far, N·m."""
        path = self.folder / f"torque_{name}"
        return float(path.read_text()) if path.exists() else 0.0

    def records(self):
        """{path of a device: its Record}."""
        from runtime.robot.rig.records import records_of

        return records_of(self.rig)

    def commission(self, *words, timeout=300.0, stop_at=None):
        """Carry out `commission` at a terminal. Returns (exit code, all that was shown).

        stop_at : (pattern, function of the Terminal) called once it is shown
        """
        with Terminal() as terminal:
            terminal.run("commission", self.rig, self.robot, "--name", "E. Person", *words, cwd=self.folder)
            operator = Operator(self, terminal)
            end = time.monotonic() + timeout
            while terminal.process.poll() is None:
                assert time.monotonic() < end, operator.text[-3000:]
                operator.look()
                if stop_at and re.search(stop_at[0], operator.text):
                    stop_at[1](terminal)
                    stop_at = None
                time.sleep(0.02)
            operator.look()
            return terminal.process.returncode, operator.text


class Operator:
    """Answers each question once, and moves the joints as it is told."""

    def __init__(self, bench, terminal):
        self.bench, self.terminal, self.text, self.seen = bench, terminal, "", 0
        self.path, self.pressed, self.last = "", None, ""

    def look(self):
        new = self.terminal.look()
        self.text += new
        self.terminal.shown = b""
        if new:
            self.pressed = None
        elif self.pressed is not None and time.monotonic() > self.pressed + 5.0:
            self.press(self.last)
        while (end := self.text.find("\n", self.seen)) >= 0 or self.pending():
            line = self.text[self.seen : end] if end >= 0 else self.text[self.seen :]
            self.seen = end + 1 if end >= 0 else len(self.text)
            self.answer(re.sub(r"\x1b\[[0-9;]*[A-Za-z]", "", line))

    def pending(self):
        """Whether the line under way is a question."""
        return "to arm" in self.text[self.seen :]

    def press(self, text="", wait=0.0):
        time.sleep(max(wait, 0.2))  # what is typed before a question is shown does not answer it
        self.pressed, self.last = time.monotonic(), text
        os.write(self.terminal.master, text.encode() + b"\n")

    def answer(self, line):
        if found := re.match(r"(\S+): .* id \d+ on legs", line):
            self.path = found[1]
        if "Serial number" in line:
            self.press()
        elif "at its zero, as" in line or "the first mark" in line or "still anywhere" in line:
            self.press(wait=0.2)
        elif "or more, and hold it" in line or "back to where it was" in line:
            self.bench.move({self.path: {"hold": 0.6 * ("or more" in line)}})
            self.press(wait=2.0)
        elif "positive direction" in line:
            self.bench.move({self.path: {"hold": 1.5708}})
            self.press(wait=2.2)
        elif "full motion" in line:
            self.bench.move({self.path: {"hold": self.bench.drives[self.path][3].get("end", 0.0)}})
            self.press(wait=1.8)
        elif "Its mass in kg" in line:
            moment = 1.2 * float(re.search(r"about ([\d.e-]+) kg", line)[1])  # kg·m
            self.bench.move({self.path: {"lever": 9.81 * moment, "inertia": 1.3 * moment * LENGTH}})
            self.press(f"{moment / LENGTH:.5f}")
        elif "Pull the CAN connector" in line:
            self.bench.plant.send_signal(signal.SIGSTOP)
        elif "put the connector back" in line:
            time.sleep(0.3)
            self.bench.plant.send_signal(signal.SIGCONT)
        elif "Did the lever fall" in line:
            self.press("y")
        elif "reading at rest" in line or "Reading while" in line:
            self.press("24" if "at rest" in line else "22.8")
        elif "cut the power" in line:
            self.press()
        elif "Distance from the axis" in line:
            self.press(str(LENGTH), wait=1.0)
        elif "yes or no" in line:
            if "that you have set" in line and self.bench.set_timeout:
                self.bench.restart()
            self.press(
                "no" if "write this" in line or "that you have set" in line and not self.bench.set_timeout else "yes"
            )
        elif "to arm" in line:
            self.press(wait=0.3)
