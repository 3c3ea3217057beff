"""An observer that plays a drive from the bytes it is sent: MIT mode, decoded with tests.blocks.actuators.reference, in
substeps of 50 µs.
"""

from tests.blocks.actuators import reference

SUBSTEP = 50_000  # ns
ENABLE, DISABLE = bytes.fromhex("fffffffffffffffc"), bytes.fromhex("fffffffffffffffd")


class PlayedDrive:
    """A drive at a joint.

    limits : reference.ranges of its model
    inertia : kg·m² of the joint, moved by the drive's torque alone; or None where `motion` imposes its velocity
    motion : called with s, gives rad/s
    log : (ns, velocity, torque) of every substep
    """

    def __init__(self, limits, can_id=1, inertia=0.35, velocity=8.0, motion=None, now=0):
        self.limits, self.can_id, self.inertia, self.motion, self.now = limits, can_id, inertia, motion, now
        self.position, self.velocity, self.law, self.log = 0.0, velocity, None, []

    def torque(self):
        if self.law is None:
            return 0.0
        return (
            self.law["stiffness"] * (self.law["position"] - self.position)
            + self.law["damping"] * (self.law["velocity"] - self.velocity)
            + self.law["torque"]
        )

    def advance(self, now):
        while self.now < now:
            if self.motion is not None:
                self.velocity = self.motion(self.now * 1e-9)
            torque = self.torque()
            self.log.append((self.now, self.velocity, torque))
            if self.motion is None:
                self.velocity += torque / self.inertia * SUBSTEP * 1e-9
            self.position += self.velocity * SUBSTEP * 1e-9
            self.now += SUBSTEP

    def hear(self, data, now):
        """A command arrives. Returns the reply."""
        self.advance(now)
        if data != ENABLE:
            self.law = None if data == DISABLE else reference.read_command(self.limits, data)
        half = self.limits["velocity"][1]
        velocity = min(max(self.velocity, -half), half)
        return reference.reply(self.limits, self.can_id, (self.position + 12.5) % 25.0 - 12.5, velocity, 0.0, 30.0, 0)

    def worst(self):
        return max(abs(torque) for _, _, torque in self.log)

    def half_time(self):
        """s from the first substep until the speed has halved."""
        began, first, _ = self.log[0]
        return next((now - began) * 1e-9 for now, velocity, _ in self.log if abs(velocity) <= 0.5 * abs(first))


def never_gains(log, slack=0.02):
    """Whether the speed never grows. slack : rad/s, for the half code that a zero velocity is off"""
    lowest = float("inf")
    for _, velocity, _ in log:
        if abs(velocity) > lowest + slack:
            return False
        lowest = min(lowest, abs(velocity))
    return True
