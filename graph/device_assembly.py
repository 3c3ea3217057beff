"""Assembly of one device: the slots of its kernels and monitors, and the frames of arming and of the safe stop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from msgspec.structs import replace

from graph.budget import damping_round
from graph.device import Actuator, Device
from graph.schedule import DeviceSteps, WatchSteps, ZeroSteps
from graph.signal import Signal

if TYPE_CHECKING:
    from graph.device_data import DampedStop, Motion


class DeviceAssembly:
    """Steps of one device. whole : graph.assembly.Assembly, in which all blocks have their slots"""

    def __init__(self, whole: Any, block: Device) -> None:
        self.whole, self.block = whole, block

    def slot(self, name: str | None) -> int:
        """Return the slot of an output, -1 for a name that is none."""
        return self.whole.places[Signal(self.block, name)].slot if name in self.block.outputs else -1

    def memory(self, name: str, index: int = 0) -> int:
        """Return the slot of a number in a memory of the block."""
        return self.whole.memory[self.block][name][0] + index

    def steps(self, buses: Sequence[str]) -> DeviceSteps:
        """Return the decode and encode steps of the device, and its frames. buses : names in the schedule's order"""
        block = self.block
        actuator = block if isinstance(block, Actuator) else None
        set_up, enable = tuple(block.set_up_frames()), tuple(block.enable_frames())
        return DeviceSteps(
            name=block.path,
            bus=buses.index(block.bus),
            decode=block.decode,
            encode=block.encode,
            decode_table=self.whole.table(block, block.decode),
            encode_table=self.whole.table(block, block.encode),
            age=self.slot("age"),
            fault=self.slot("fault") if actuator or block.relay_time else -1,
            timeout=block.timeout,
            ask=tuple(block.ask_frames()) if actuator else (),
            # a sensor may be set up, and a device other than an actuator enabled, before the operator confirms
            set_up=set_up if actuator else set_up + enable,
            enable=enable if actuator else (),
            zero=tuple(block.zero_frames()),
            disable=tuple(block.disable_frames()),
            damp=self.damped_stop(),
            stop_reply=block.stop_reply(),
            unanswered=block.unanswered_frames,
            relay_time=block.relay_time,
            start_time=block.start_time,
            watch=self.watch_steps(),
            warning=self.slot("warning") if actuator else -1,
            warnings=tuple(actuator.warnings_in_words()) if actuator and "warning" in block.outputs else (),
            reads=tuple(block.read_frames()),
            cap=self.whole.compilation.caps.get(block),
            commanded=actuator.commanded_torque() if actuator else None,
            reports_enabled=block.reports_enabled,
            zeroing=self.zero_steps(),
            **self.reply_steps(),
            **self.switch_slots(),
            **self.ready_place(),
        )

    def reply_steps(self) -> dict[str, Any]:
        """Return how the device answers commands, as fields of DeviceSteps; {} if it does not state it."""
        block, replies = self.block, self.block.command_replies()
        if replies is None:
            return {}
        return {
            "answers": replies.report_rate <= 0.0,
            "transit": self.memory("transit") if "transit" in self.whole.memory.get(block, {}) else -1,
            "max_transit": replies.max_transit,
            "restart_time": replies.restart_time,
            "report_period": 1.0 / replies.report_rate if replies.report_rate > 0.0 else 0.0,
            "set_up_replies": len(block.set_up_frames()) if replies.to_set_up is None else replies.to_set_up,
        }

    def damped_stop(self) -> DampedStop | None:
        """Return the DampedStop of the device, with a round for which its bus has the capacity."""
        stop = self.block.damped_stop()
        return stop and replace(stop, round=max(stop.round, damping_round(self.block.bus, self.whole.blocks)))

    def ready_place(self) -> dict[str, Any]:
        """Return the slot and size of the memory `ready`; {} if the device has none."""
        if self.block.ready is None:
            return {}
        slot, size = self.whole.memory[self.block][self.block.ready][:2]
        return {"ready": slot, "ready_size": size}

    def watch_steps(self) -> WatchSteps | None:
        """Return what the drive monitor reads; None for a device without one."""
        watch, caps = self.block.watched(), self.whole.compilation.caps.get(self.block)
        if watch is None:
            return None
        remaining, full = -1, 0.0
        if watch.law_limit:
            name, index = watch.law_limit
            remaining, full = self.memory(name, index), float(vars(self.block)[name][index])
        if caps is not None:  # the kernel reads its limit from here, and a block cannot change what is written here
            full = min(full * caps.share(watch.limit), caps.torque)
            watch = caps.of_watch(watch)
        return WatchSteps(
            watch,
            self.slot("torque"),
            self.slot("temperature"),
            self.slot("rms_torque"),
            remaining,
            full,
            **self.motion_slots(watch.motion),
        )

    def zero_steps(self) -> ZeroSteps | None:
        """Return how the zero of a drive is set; None if it cannot be set."""
        block, zeroing, watch = self.block, self.block.zeroing(), self.block.watched()
        if zeroing is None:
            return None
        motion = {} if watch is None else self.motion_slots(watch.motion)
        request = self.whole.input_slot(block, "zero") if "zero" in block.inputs else -1
        return ZeroSteps(zeroing, self.slot("position"), request, motion.get("law", -1), motion.get("current", -1))

    def switch_slots(self) -> dict[str, int]:
        """Return {field of DeviceSteps: slot} of a drive that can be taken out during a run, {} for another device."""
        block = self.block
        if not isinstance(block, Actuator) or "disabled" not in block.parameters:
            return {}
        return {
            "disabled_slot": self.whole.parameters[f"{block.path}.disabled"],
            "disable_slot": self.whole.input_slot(block, "disable"),
            "active_slot": self.slot("active"),
        }

    def motion_slots(self, motion: Motion | None) -> dict[str, int]:
        """Return {field of WatchSteps: slot} for the watch of an actuator's motion, {} without one."""
        if motion is None:
            return {}
        slots = {"position": self.slot("position"), "velocity": self.slot("velocity")}
        slots["current"] = self.slot(motion.current)
        if motion.law is not None:
            slots["law"] = self.memory(motion.law)
        if motion.gains is not None:
            for quantity in ("stiffness", "damping"):
                slots[quantity] = self.whole.input_slot(self.block, f"{quantity}_command")
            slots["gains"] = self.memory(*motion.gains)
        return slots
