"""What arming reads from a RobStride in either protocol: its settings, and the measurements that replies also have."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from blocks.actuators.robstride import frames
from graph import Param

if TYPE_CHECKING:
    from graph.dialogue import Dialogue


class ReadBack:
    """Comparison of a drive with its parameters. A block defines `compared` and `written_settings`."""

    verify_ranges = Param(
        True,
        "1",
        "whether arming compares the replies with the parameters mechPos and mechVel, and refuses other ranges",
        fixed=True,
        kernel=False,
    )

    compared: tuple[int, ...]
    written_settings: Any

    def compared_in_words(self) -> str:
        """Return the measurements that arming compares with parameters."""
        return frames.compared_in_words(self.compared)

    def settings_read(self) -> int:
        """Return the number of settings that arming reads back."""
        return len(self.written_settings())

    def read_parameter(self, name: str) -> Dialogue:
        """Dialogue that returns a parameter of the drive, such as mechPos in rad; None if it does not return it."""
        raise NotImplementedError
