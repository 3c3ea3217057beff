"""Commands to a MicroStrain sensor that is set up: sent, kept for a reconnect, and read back."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from blocks.imus.microstrain import mip
from blocks.imus.microstrain.descriptors import is_known
from blocks.imus.microstrain.queries import Refusal, ask
from graph.dialogue import Rejected

if TYPE_CHECKING:
    from blocks.imus.microstrain.descriptors import Field
    from graph.dialogue import Dialogue

GENERIC_FORMAT = 0x0C0F
VENDOR_PROGRAM = "MicroStrain's program SensorConnect shows which settings the sensor accepts"


class Commands:
    """device : blocks.imus.MicroStrain; known : commands and data of the sensor

    newer : whether it is of the newer generation
    messages : packets sent again after a reconnect; remarks : texts for the operator
    settings : {name: text} as read back
    """

    def __init__(self, device: Any, known: set[int]) -> None:
        self.device, self.known = device, known
        self.newer = GENERIC_FORMAT in known
        self.messages = [mip.command(mip.BASE, mip.IDLE)]
        self.remarks: list[str] = []
        self.settings: dict[str, str] = {}

    def has(self, field: Field) -> bool:
        """Return whether the sensor can send a field."""
        return is_known(field, self.known)

    def apply(self, packet: bytes, what: str) -> Dialogue:
        """Send a setting, and keep it for a reconnect."""
        yield from self.ask(packet, what)
        self.messages.append(packet)

    def read(self, command: int, reply: int, *selector: int, required: bool) -> Dialogue:
        """Return the data of a setting.

        selector : bytes that name it; required : whether the block sets it, so that a sensor that does not return it is
        rejected; otherwise None is returned for it
        """
        packet = mip.packet(command >> 8, (command & 0xFF, bytes((mip.READ, *selector))))
        try:
            found = (yield from ask(packet)).get(reply)
        except Refusal as refusal:
            found = self.refuse(f"reading {command:04X}: {refusal}", VENDOR_PROGRAM) if required else None
        if found is None and required:
            self.refuse(f"its reply to {command:04X} has no setting", VENDOR_PROGRAM)
        return found

    def confirm(self, what: str, is_so: bool, found: str, wanted: str) -> None:
        """Keep a setting as read back. Raises Rejected if it is not as it was set.

        found, wanted : setting that was read and setting that was written, as text
        """
        if not is_so:
            self.refuse(f"its {what} was set to {wanted}, but reads back as {found}", VENDOR_PROGRAM)
        self.settings[what] = found

    def ask(self, packet: bytes, what: str) -> Dialogue:
        """Send a packet and return the reply. Raises Rejected if the sensor refuses it.

        what : name of the packet, for the message
        """
        try:
            return (yield from ask(packet))
        except Refusal as refusal:
            self.refuse(f"{what}: {refusal}", VENDOR_PROGRAM)

    def refuse(self, message: str, hint: str) -> Any:
        """Raise Rejected."""
        raise Rejected(message, hint)
