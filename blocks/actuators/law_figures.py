"""Figures that follow from the assumption on acceleration for a drive that closes its own law.

See cext/kernels/devices/drive_law.pxd.
"""

from msgspec import Struct

from cext.safety.thresholds import GUARDIAN_LOOK_PERIOD, LOOP_STALL_MINIMUM, LOOP_STALL_PERIODS
from graph import Interval

HORIZON = 3.0  # periods from feedback that is one period old to the end of a late frame
HALF_WAY = 1.5  # and to the middle of one in time
SPEED = 10.0  # rad/s of a joint when its loop stalls: beyond fast walking


class Law(Struct, frozen=True):
    """Limits and commands of a drive's impedance law, all at the joint.

    limit : N·m
    acceleration : rad/s²
    period : s
    stiffness, damping : Intervals of the commands in N·m/rad and N·m·s/rad
    max_transit : s, longest time from a command to its reply; at least a period
    """

    limit: float
    acceleration: float
    period: float
    stiffness: Interval
    damping: Interval
    max_transit: float = 0.0

    @property
    def usable_damping(self) -> float:
        """Return 2 limit / (a Δ), the largest damping sent if the law exceeds the limit."""
        return 2.0 * self.limit / (self.acceleration * HORIZON * self.period)

    @property
    def smallest_inertia(self) -> float:
        """Return the inertia in kg·m² above which a free joint settles; a lighter one may chatter, within the limit.

        J > T (B + K' T)² / B, Jury's criterion for torque from feedback that is one period old, held for one period. K'
        is the stiffness that the law sends as torque; gains in the drive only improve this. Without stiffness it is
        J > T B. Below a quarter of the usable damping the drive itself is the spring, and the figure no longer changes.
        """
        stiffness, damping = self.stiffness.high, min(self.damping.high, self.usable_damping)
        if stiffness <= 0.0:
            return self.period * damping
        damping = max(damping, 0.25 * self.usable_damping)
        end = HORIZON * self.period
        share = min(
            1.0, self.limit / (stiffness * 0.5 * self.acceleration * end**2 + damping * self.acceleration * end)
        )
        sent = min(stiffness, share * stiffness + 0.5 * damping / (HALF_WAY * self.period))
        return self.period * (damping + sent * self.period) ** 2 / damping

    @property
    def stall_time(self) -> float:
        """Return the time in s from the last frame of a stalled loop to the guardian's stop."""
        return max(LOOP_STALL_PERIODS * self.period, LOOP_STALL_MINIMUM * 1e-9) + GUARDIAN_LOOK_PERIOD * 1e-9

    def stall_torque(self, motion: float) -> float:
        """Return the largest torque in N·m of the last frame of a stalled loop, from |ω| <= SPEED.

        motion : bound of |α|, rad/s²
        """
        end, half, stopped = HORIZON * self.period, HALF_WAY * self.period, self.period + self.stall_time
        worst = self.limit
        for k, b in (
            (self.stiffness.high, self.damping.high),
            (self.stiffness.high, self.damping.low),
            (self.stiffness.low, self.damping.high),
        ):
            b = min(b, self.usable_damping)
            for step in range(33):
                speed = SPEED * step / 32.0
                spread = k * (speed * (end - half) + 0.5 * self.acceleration * end**2) + b * self.acceleration * end
                reached = k * (speed * (stopped - half) + 0.5 * motion * stopped**2) + b * motion * stopped
                share = min(1.0, self.limit / spread) if spread > 0.0 else 0.0
                worst = max(worst, self.limit + share * (reached - spread))
        return worst

    def figures(self) -> tuple[tuple[str, float, str, str], ...]:
        """Return the figures for graph.TorqueBound."""
        reached = f"torque that a stall can reach in that time, from |ω| <= {SPEED:g} rad/s, while |α| <= "
        slower = 0.25 * self.acceleration
        return (
            (
                "max_transit",
                max(self.max_transit, self.period),
                "s",
                "longest time from a command to its reply on which this rests; beyond, as the run measures it, "
                "stiffness and damping are zero",
            ),
            (
                "later_command",
                self.period,
                "s",
                "delay of a command, beyond that of the commands before it, on which this rests; a longer one is "
                "measured only when its reply arrives",
            ),
            ("usable_damping", self.usable_damping, "N·m·s/rad", "usable damping if the whole law exceeds the limit"),
            (
                "smallest_inertia",
                self.smallest_inertia,
                "kg·m²",
                "smallest inertia of a free joint, rotor included, that does not chatter",
            ),
            ("stall_time", self.stall_time, "s", "time from the last frame of a stalled loop to the guardian's stop"),
            ("stall_torque", self.stall_torque(self.acceleration), "N·m", f"{reached}{self.acceleration:g} rad/s²"),
            ("stall_torque_slower", self.stall_torque(slower), "N·m", f"{reached}{slower:g} rad/s²"),
        )
