"""An observer on the bus that plays a drive from its protocol sheet alone, in whole numbers, and notes every torque
that the drive gives.

Nothing of it is taken from this project but the block that is observed: its decode reads the observer's replies, its
encode makes the frames. The law is evaluated at `SUBSTEPS` instants of each period, at the true state. All figures of
the sheet are of the motor; what comes back is at the joint.
"""

import numpy as np

from tests.blocks.actuators.wire import EXTENDED, Wired

SUBSTEPS = 20
PERIOD_SLOT = 3  # cext/abi.pxd


def code(x, low, high, bits):
    """A number as the sheets have it: truncated, and clamped."""
    return int(min(max((x - low) / (high - low), 0.0), 1.0) * (2**bits - 1))


def value(code, low, high, bits):
    return low + code * (high - low) / (2**bits - 1)


class Sheet:
    """Ranges of one model from its protocol sheet. half : of position, velocity and torque; top : of stiffness and
    damping
    """

    def __init__(self, position, velocity, torque, stiffness=500.0, damping=5.0):
        self.position, self.velocity, self.torque, self.stiffness, self.damping = (
            position,
            velocity,
            torque,
            stiffness,
            damping,
        )

    @property
    def torque_code(self):
        return 2.0 * self.torque / (2**self.bits - 1)

    def fields(self, **codes):
        """(θ₀, ω₀, K, B, τ) of the motor."""
        half = {"p": self.position, "v": self.velocity, "t": self.torque}
        top = {"kp": self.stiffness, "kd": self.damping}
        bits = {name: 16 if name == "p" else self.bits for name in codes}
        return [
            value(codes[n], -half[n] if n in half else 0.0, half.get(n) or top[n], bits[n])
            for n in ("p", "v", "kp", "kd", "t")
        ]


class Mit(Sheet):
    """Standard frames, p16 v12 kp12 kd12 t12; reply: id p16 v12 t12 and two bytes more. host : id of the replies, the
    drive's own where None
    """

    bits = 12

    def __init__(self, *half, host=None, rest=b"\x46\x00", **top):
        super().__init__(*half, **top)
        self.host, self.rest = host, rest

    def command(self, identifier, data):
        assert identifier < 0x800 and len(data) == 8
        n = int.from_bytes(data, "big")
        return self.fields(p=n >> 48, v=n >> 36 & 0xFFF, kp=n >> 24 & 0xFFF, kd=n >> 12 & 0xFFF, t=n & 0xFFF)

    def reply(self, can_id, position, velocity):
        motion = (
            code(position, -self.position, self.position, 16) << 24
            | code(velocity, -self.velocity, self.velocity, 12) << 12
            | 0x7FF
        )
        return can_id if self.host is None else self.host, bytes([can_id]) + motion.to_bytes(5, "big") + self.rest


class ForceControl(Sheet):
    """CubeMars V3.0: kp12 kd12 p16 v12 t12 in extended frames; the status has 0.1°, 10 electrical revolutions a minute
    and 0.01 A.
    """

    bits = 12

    def __init__(self, *half, gear, pole_pairs):
        super().__init__(*half)
        self.electrical = gear * pole_pairs * 30.0 / np.pi

    def command(self, identifier, data):
        assert identifier & EXTENDED and identifier >> 8 & 0x1FFFFF == 8 and len(data) == 8
        n = int.from_bytes(data, "big")
        return self.fields(kp=n >> 52, kd=n >> 40 & 0xFFF, p=n >> 24 & 0xFFFF, v=n >> 12 & 0xFFF, t=n & 0xFFF)

    def reply(self, can_id, position, velocity):
        words = [int(np.degrees(position) * 10.0), int(velocity * self.electrical / 10.0), 0]
        return EXTENDED | 0x29 << 8 | can_id, b"".join(
            word.to_bytes(2, "big", signed=True) for word in words
        ) + b"\x1e\x00"


class Private(Sheet):
    """RobStride's own protocol: u16 each, torque in the identifier; feedback of type 2, running."""

    bits = 16

    def command(self, identifier, data):
        assert identifier & EXTENDED and identifier >> 24 & 31 == 1 and len(data) == 8
        p, v, kp, kd = (int.from_bytes(data[i : i + 2], "big") for i in (0, 2, 4, 6))
        return self.fields(p=p, v=v, kp=kp, kd=kd, t=identifier >> 8 & 0xFFFF)

    def reply(self, can_id, position, velocity):
        motion = [
            code(position, -self.position, self.position, 16),
            code(velocity, -self.velocity, self.velocity, 16),
            0x7FFF,
            300,
        ]
        return EXTENDED | 2 << 24 | 2 << 22 | can_id << 8 | 0xFD, b"".join(word.to_bytes(2, "big") for word in motion)


class Observed:
    """One actuator and the observer that plays its drive.

    kind, model, parameters : of the block; sheet : of its drive; rate : Hz
    """

    def __init__(self, kind, model, sheet, rate=200, **parameters):
        self.wired = Wired(kind, model, can_id=7, **parameters)
        self.sheet, self.period = sheet, 1.0 / rate
        self.wired.arena[PERIOD_SLOT] = self.period
        block = self.wired.block
        self.sign, self.offset, self.ratio = -1.0 if block.invert else 1.0, block.offset, block.gear_ratio
        self.limit, self.torque_code = block.torque_limit, sheet.torque_code * self.ratio

    def again(self, rate=None, limit=None, acceleration=None):
        """Another one in its first state; without compiling, also with another rate, limit in N·m and
        max_acceleration.
        """
        new = object.__new__(type(self))
        vars(new).update(vars(self), wired=Wired.again(self.wired), period=1.0 / rate if rate else self.period)
        new.wired.arena[PERIOD_SLOT] = new.period
        if limit is not None:
            new.limit = limit
            new.wired["limits"] = [*new.wired["limits"][:4], limit, limit, 1.0]
        if acceleration is not None:
            new.wired["max_acceleration"] = acceleration
        return new

    def hear(self, position, velocity, age):
        """The reply of a drive that was there so long ago."""
        scale = self.sign * self.ratio
        answer = self.sheet.reply(7, scale * (position + self.offset), scale * velocity)
        assert self.wired.hear(*answer) > 0
        self.wired["age"] = age

    def law(self, **commands):
        """(θ₀, ω₀, K, B, τ) at the joint, of the frame that goes out now."""
        [(identifier, data)] = self.wired.say(**{f"{name}_command": value for name, value in commands.items()})
        position, velocity, stiffness, damping, torque = self.sheet.command(identifier, data)
        scale, square = self.sign / self.ratio, self.ratio**2
        return np.array(
            [
                scale * position - self.offset,
                scale * velocity,
                square * stiffness,
                square * damping,
                self.sign * self.ratio * torque,
            ]
        )

    def follow(self, motion, seconds, commands, age=1.0, late=0.0, random=None):
        """Torque of the drive with an imposed motion: (instants, torques, |α|, whole laws), all of shape (ticks,
        SUBSTEPS).

        motion(t) : position, velocity, acceleration; commands(t) : a dict
        age, late : of the feedback, and by which frames come late, in periods; with `random`, at most so much
        """
        ticks = round(seconds / self.period)
        share = np.arange(SUBSTEPS) / SUBSTEPS
        times, torques, wanted = np.empty((ticks, SUBSTEPS)), np.empty((ticks, SUBSTEPS)), np.empty((ticks, SUBSTEPS))
        lateness = np.zeros(ticks + 1) if random is None else late * random.random(ticks + 1)
        if random is None:
            lateness[::2] = late
        for tick in range(ticks):
            now = tick * self.period
            old = age * self.period * (1.0 if random is None else random.random())
            self.hear(*motion(now - old)[:2], old)
            asked = commands(now)
            law = self.law(**asked)
            begin, end = now + lateness[tick] * self.period, now + (1.0 + lateness[tick + 1]) * self.period
            t = times[tick] = begin + (end - begin) * share
            position, velocity, _ = motion(t)
            torques[tick] = torque_of(law, position, velocity)
            wanted[tick] = torque_of(
                [asked.get(n, 0.0) for n in ("position", "velocity", "stiffness", "damping", "torque")],
                position,
                velocity,
            )
        return times, torques, np.abs(motion(times)[2]), wanted

    def move(self, inertia, seconds, commands, position=0.0, velocity=0.0, friction=0.0):
        """A free joint that the drive moves: (position, velocity, torque) at each instant."""
        ticks, step = round(seconds / self.period), self.period / SUBSTEPS
        kept = np.empty((ticks * SUBSTEPS, 3))
        heard = position, velocity
        row = 0
        for tick in range(ticks):
            self.hear(*heard, self.period if tick else 0.0)
            law = self.law(**commands(tick * self.period)).tolist()
            heard = position, velocity
            for _ in range(SUBSTEPS):
                torque = law[2] * (law[0] - position) + law[3] * (law[1] - velocity) + law[4]
                kept[row] = position, velocity, torque
                velocity += step * (torque - friction * velocity) / inertia
                position += step * velocity
                row += 1
        return kept.T


def worst(law, position, velocity, age, period, acceleration):
    """The largest torque of a law over the time for which it holds, with the acceleration at either bound or nothing.
    No other motion has more: what an acceleration adds at any instant, K times the time left plus B, has one sign.
    """
    after = np.linspace(age, age + 2.0 * period, 17)
    return max(
        np.abs(torque_of(law, position + velocity * after + 0.5 * a * after**2, velocity + a * after)).max()
        for a in (-acceleration, 0.0, acceleration)
    )


def torque_of(law, position, velocity):
    """τ = K (θ₀ − θ) + B (ω₀ − ω) + τ_ff."""
    return law[2] * (law[0] - position) + law[3] * (law[1] - velocity) + law[4]
