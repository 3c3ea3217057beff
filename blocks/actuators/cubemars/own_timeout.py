"""Time-out in the board of a CubeMars, which no CAN frame sets or returns: its operator declares it."""

from __future__ import annotations

from graph import Param


class DeclaredTimeout:
    """Time-out of a drive as it was set with the vendor's tool."""

    drive_timeout = Param(
        None,
        "s",
        "time without a command after which the drive gives no torque, as set with the vendor's tool; `commission` "
        "measures it. None if unknown",
        dtype=float,
        above=0.0,
        max=5.0,
        fixed=True,
        kernel=False,
    )

    own_timeout: float | None
    own_timeout_declared: bool = True
    timeout_entry: tuple[str, ...] = (  # lines for the operator who sets 0.1 s
        "  no CAN frame and no terminal command sets it in servo mode and with a V3.0 board",
        "  in the vendor's tool, set timeout_msec to 100 in the parameters of the drive, and write them",
    )

    def check_timeout(self, dt: float | None) -> None:
        """Raise ValueError if the drive would stop between two commands. dt : s"""
        if dt is not None and self.drive_timeout is not None and self.drive_timeout < 2.0 * dt:
            raise ValueError(
                f"drive_timeout {self.drive_timeout:g} s is shorter than two ticks of {dt:g} s: the drive would stop "
                "between two commands"
            )
