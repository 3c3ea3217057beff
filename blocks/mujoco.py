"""Bodies in MuJoCo's format, MJCF, which MuJoCo simulates in lockstep with the diagram."""

from __future__ import annotations

import ctypes
import importlib
import importlib.util
import os
import re
from collections.abc import Collection
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from blocks._plumbing.mjcf_size import check_size
from blocks._plumbing.paths import file_param
from blocks._plumbing.ports import port_name
from cext.kernels.mujoco import IN_USE, UNSTABLE, Simulation, advance, observe
from graph import Block, Input, Memory, Output, Param
from graph.narrowing import is_row

EXTRA = "pip install 'tickwork[mujoco]'"
MEMORY = 'contacts or constraints do not fit in the memory of MuJoCo: increase <size memory="..."/> in the MJCF file'
STEP_TOLERANCE = 1e-6  # relative difference of a tick from a whole number of MuJoCo's time steps
FULL = "CONTACTFULL", "CNSTRFULL"  # warnings of contacts and constraints that MuJoCo leaves out
WARNINGS = {"BADCTRL": "control", "BADQPOS": "position", "BADQVEL": "velocity", "BADQACC": "acceleration"}
FILES = re.compile(r"""\b(?:file|\w+dir)\s*=\s*["']([^"']+)["']""")

# Units of sensors, by the names of mjtSensor; those of a joint or an actuator are in `unit_of_sensor`.
UNITS = {
    "m": "FRAMEPOS SUBTREECOM RANGEFINDER TENDONPOS TENDONLIMITPOS GEOMDIST GEOMFROMTO",
    "m/s": "VELOCIMETER FRAMELINVEL SUBTREELINVEL TENDONVEL TENDONLIMITVEL",
    "m/s²": "ACCELEROMETER FRAMELINACC",
    "rad/s": "GYRO FRAMEANGVEL BALLANGVEL",
    "rad/s²": "FRAMEANGACC",
    "N": "TOUCH FORCE TENDONACTFRC TENDONLIMITFRC",
    "N·m": "TORQUE",
    "kg·m²/s": "SUBTREEANGMOM",
    "T": "MAGNETOMETER",
    "J": "E_POTENTIAL E_KINETIC",
    "s": "CLOCK",
}
UNIT_OF_SENSOR = {name: unit for unit, names in UNITS.items() for name in names.split()}
TURNING, SLIDING = ("rad", "rad/s", "N·m"), ("m", "m/s", "N")  # units of position, velocity and force


class MujocoBody(Block):
    """Body in an MJCF file, which MuJoCo advances by one tick of the diagram: a plant with contacts and many joints.

    The ports follow from the model, by the names in the file. Characters that an identifier cannot have become
    underscores, and x comes before a name that would begin with a digit or an underscore. What has no name has no port.

    Each actuator is an input: N·m or N for a motor, rad or m and their rates for a servo, else 1. A hinge or slide
    `knee` has the outputs `knee_position` and `knee_velocity` and the input `knee_torque` (slide: `knee_force`), a
    torque on the joint in addition to its actuators: connect the emulated drive of a robot there. A ball joint has
    `_orientation` and `_velocity`; a free joint `_position`, `_orientation` (w, x, y, z), `_velocity` in the world and
    `_rate` in the body. Each sensor is an output. A name that an earlier port has gets the suffix `_actuator` or
    `_sensor`. Inputs that are not connected are 0.

    Outputs do not depend on the inputs of the same tick. Positions and velocities are those of the tick, and sensors
    those of the last time step of MuJoCo, which begins one step earlier. The tick must be a multiple of that step. A
    run repeats bit for bit with the same version of MuJoCo on the same kind of processor. NaN, a diverging motion, or
    contacts that do not fit in its memory end the run with a fault. Requires MuJoCo: `pip install 'tickwork[mujoco]'`.
    """

    file = file_param("MJCF file")
    keyframe = Param("", "1", "name of the keyframe of the file at the start; by default the reference pose", dtype=str)
    pose = Param((), "1", 'positions of hinges and slides at the start in rad or m, as in (("knee", 0.4),)')
    spread = Param(
        0.0,
        "1",
        "standard deviation in rad or m, by which the start of each hinge and slide varies with the seed",
        min=0.0,
        fixed=True,
        kernel=False,
    )
    seed = Param(0, "1", "seed of the start", min=0, max=2**53, fixed=True, kernel=False)

    state = Memory(0.0, "address of the simulation")
    steps = Memory(1.0, "time steps of MuJoCo per tick")
    count = Memory(0.0, "steps of the block since the start")

    feedthrough = ()
    kernel = observe
    update_kernel = advance

    def configure(self) -> None:
        self.mujoco = mujoco = library()
        try:
            check_size(Path(self.file))
            self.model = mujoco.MjModel.from_xml_path(self.file)
        except ValueError as error:
            raise ValueError(f"{self.file}: {str(error).removeprefix('Error: ')}") from None
        try:
            self.data, initial = mujoco.MjData(self.model), self.initial()
        except mujoco.FatalError as error:
            raise ValueError(f"{self.file}: {' '.join(str(error).split())}") from None
        ports = Ports(mujoco, self.model, self.data, _RESERVED_NAMES)
        self.inputs = {name: port for name, (port, _) in ports.inputs.items()}
        self.outputs = {name: port for name, (port, _) in ports.outputs.items()}
        simulation = Simulation(
            functions(mujoco),
            self.model,
            self.data,
            initial,
            [address_of(self.data.warning.number, self.warning(name)) for name in (*WARNINGS, *FULL)],
            [address for _, address in ports.inputs.values()],
            [address for _, address in ports.outputs.values()],
        )
        self.state = simulation.address
        self.kernel, self.update_kernel = observe.owned(simulation), advance.owned(simulation)

    def initial(self) -> Any:
        """Return the mjData of the start. Raises ValueError for an unknown keyframe or joint."""
        mujoco, model = self.mujoco, self.model
        data = mujoco.MjData(model)
        if self.keyframe:
            names = [model.key(k).name for k in range(model.nkey)]
            if self.keyframe not in names:
                raise ValueError(f"keyframe: {self.file} has no {self.keyframe!r}, it has {listed(names)}")
            mujoco.mj_resetDataKeyframe(model, data, names.index(self.keyframe))
        places = {model.joint(k).name: model.jnt_qposadr[k] for k in range(model.njnt) if model.jnt_type[k] >= 2}
        for each in self.pose if is_row(self.pose) else (self.pose,):
            if not (is_row(each) and len(each) == 2 and isinstance(each[0], str) and isinstance(each[1], Real)):
                example = 'pose=(("knee", 0.4),) with a comma after a single one'
                raise ValueError(f"pose must be pairs of a joint and its position, as in {example}, got {each!r}")
            joint, position = each
            if joint not in places:
                raise ValueError(f"pose: {self.file} has no hinge or slide {joint!r}, it has {listed(places)}")
            data.qpos[places[joint]] = position
        deviations = np.random.default_rng(self.seed).normal(scale=self.spread, size=len(places))
        data.qpos[list(places.values())] += deviations
        if not np.isfinite(data.qpos).all():
            raise ValueError(f"{self.file}: a position of its keyframe {self.keyframe!r} or of `pose` is not finite")
        mujoco.mj_forward(model, data)
        if any(data.warning.number[self.warning(name)] for name in FULL):
            raise ValueError(f"{self.file}: {MEMORY}")
        return data

    def prepare(self, dt: float) -> None:
        """Set the time steps per tick. Raises ValueError for a time step that does not divide it."""
        step = float(self.model.opt.timestep)
        steps = round(dt / step)
        if steps < 1 or abs(steps * step - dt) > STEP_TOLERANCE * dt:
            raise ValueError(
                f"the time step in {self.file}, {step:g} s, does not divide the tick of the block, {dt:g} s: use "
                f'<option timestep="{dt / max(1, round(dt / step)):.9g}"/> there, or a plant of another rate'
            )
        self.steps = float(steps)

    def warning(self, name: str) -> int:
        """Return the index of a warning of MuJoCo. name : a key of WARNINGS"""
        return getattr(self.mujoco.mjtWarning, f"mjWARN_{name}").value

    def fault_text(self, status: int) -> str:
        """Return the text of a status of the kernels."""
        if status == IN_USE:
            return "two programs use its simulation at the same time"
        if status != UNSTABLE:
            return ""
        model, found = self.model, self.data.warning
        if any(found[self.warning(name)].number for name in FULL):
            return MEMORY
        name = next((name for name in WARNINGS if found[self.warning(name)].number), None)
        if name is None:
            return "the simulation of MuJoCo is unstable"
        index = found[self.warning(name)].lastinfo
        if name == "BADCTRL":
            where = f"actuator {model.actuator(index).name or index}"
        else:
            joints = model.jnt_qposadr if name == "BADQPOS" else model.jnt_dofadr
            joint = int(np.searchsorted(np.asarray(joints), int(index), side="right")) - 1
            where = f"joint {model.joint(joint).name or joint}"
        return (
            f"the {WARNINGS[name]} of {where} is NaN, infinite or beyond MuJoCo's bounds: check the inputs of the "
            "block, or use a shorter time step or an implicit integrator in the MJCF file"
        )

    def files_of(self, name: str) -> list[Path]:
        """Return the MJCF file, and the files that it includes or refers to."""
        return sorted(files_of(Path(self.file)), key=lambda path: (path != Path(self.file), path))


class Ports:
    """Ports of a model: {name: (port, address of its first number)}, as `inputs` and `outputs`."""

    def __init__(self, mujoco: Any, model: Any, data: Any, reserved: Collection[str]) -> None:
        self.mujoco, self.model, self.data, self.reserved = mujoco, model, data, reserved
        self.inputs: dict[str, tuple[Input, int]] = {}
        self.outputs: dict[str, tuple[Output, int]] = {}
        for joint in range(model.njnt):
            self.add_joint(joint)
        for actuator in range(model.nu):
            unit = self.unit_of_actuator(actuator)
            port = Input(unit, "control of the actuator", default=0.0)
            self.add(self.inputs, model.actuator(actuator).name, "_actuator", port, data.ctrl, actuator)
        for sensor in range(model.nsensor):
            length = int(model.sensor_dim[sensor])
            kind = mujoco.mjtSensor(model.sensor_type[sensor]).name.removeprefix("mjSENS_")
            port = Output(
                self.unit_of_sensor(sensor, kind), f"sensor, {kind.lower()}", shape=(length,) if length > 1 else ()
            )
            place = int(model.sensor_adr[sensor])
            self.add(self.outputs, model.sensor(sensor).name, "_sensor", port, data.sensordata, place)

    def add(self, ports: dict[str, Any], name: str, suffix: str, port: Any, numbers: Any, index: int) -> None:
        """Add a port, whose numbers begin at an index of an array of mjData. name : in the file, or "" """
        if not name:
            return
        name = port_name(name, {*self.reserved, *self.inputs, *self.outputs}, suffix)
        if name in self.inputs or name in self.outputs:
            raise ValueError(f"two elements of the model would be the port {name}: rename one of them")
        ports[name] = (port.named(name), address_of(numbers, index))

    def add_joint(self, joint: int) -> None:
        """Add the ports of a joint."""
        model, data = self.model, self.data
        name, place, rate = model.joint(joint).name, int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        if not name:
            return
        kind = self.mujoco.mjtJoint(model.jnt_type[joint]).name.removeprefix("mjJNT_")
        if kind in ("HINGE", "SLIDE"):
            position, velocity, force = TURNING if kind == "HINGE" else SLIDING
            word = "torque" if kind == "HINGE" else "force"
            outputs = [("position", position, (), data.qpos, place), ("velocity", velocity, (), data.qvel, rate)]
            port = Input(force, f"{word} on the joint besides its actuators", default=0.0)
            self.add(self.inputs, f"{name}_{word}", "_joint", port, data.qfrc_applied, rate)
        elif kind == "BALL":
            outputs = [("orientation", "1", (4,), data.qpos, place), ("velocity", "rad/s", (3,), data.qvel, rate)]
        else:
            outputs = [
                ("position", "m", (3,), data.qpos, place),
                ("orientation", "1", (4,), data.qpos, place + 3),
                ("velocity", "m/s", (3,), data.qvel, rate),
                ("rate", "rad/s", (3,), data.qvel, rate + 3),
            ]
        for word, unit, shape, numbers, index in outputs:
            port = Output(unit, f"{word} of the joint", shape=shape)
            self.add(self.outputs, f"{name}_{word}", "_joint", port, numbers, index)

    def units_of_actuator(self, actuator: int) -> tuple[str, str, str]:
        """Return the units of length, velocity and force of an actuator; ("1", "1", "1") if they are not known."""
        model, kinds = self.model, self.mujoco.mjtTrn
        kind, target = model.actuator_trntype[actuator], model.actuator_trnid[actuator][0]
        if kind in (kinds.mjTRN_JOINT.value, kinds.mjTRN_JOINTINPARENT.value):
            if model.jnt_type[target] == self.mujoco.mjtJoint.mjJNT_FREE.value:
                along, about = np.any(model.actuator_gear[actuator].reshape(2, 3), axis=1)
                return ("1", "1", "1") if along and about else SLIDING if along else TURNING
            return self.units_of_joint(target)
        return SLIDING if kind == kinds.mjTRN_TENDON.value else ("1", "1", "1")

    def units_of_joint(self, joint: int) -> tuple[str, str, str]:
        """Return the units of position, velocity and force of a joint."""
        return SLIDING if self.model.jnt_type[joint] == self.mujoco.mjtJoint.mjJNT_SLIDE.value else TURNING

    def unit_of_actuator(self, actuator: int) -> str:
        """Return the unit of the control of an actuator."""
        model, mujoco = self.model, self.mujoco
        position, velocity, force = self.units_of_actuator(actuator)
        gain, bias = model.actuator_gainprm[actuator], model.actuator_biasprm[actuator]
        fixed = model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED.value
        kind = model.actuator_biastype[actuator]
        if fixed and kind == mujoco.mjtBias.mjBIAS_NONE.value and gain[0] == 1.0:
            return force
        if fixed and kind == mujoco.mjtBias.mjBIAS_AFFINE.value and gain[0]:
            return position if bias[1] == -gain[0] else velocity if bias[1] == 0.0 and bias[2] == -gain[0] else "1"
        return "1"

    def unit_of_sensor(self, sensor: int, kind: str) -> str:
        """Return the unit of a sensor. kind : name in mjtSensor"""
        target = int(self.model.sensor_objid[sensor])
        quantity = {"POS": 0, "VEL": 1, "FRC": 2}.get(kind[-3:])
        if quantity is not None and kind.startswith("JOINT"):
            return self.units_of_joint(target)[quantity]
        if quantity is not None and kind.startswith("ACTUATOR"):
            return self.units_of_actuator(target)[quantity]
        return UNIT_OF_SENSOR.get(kind, "1")


def library() -> Any:
    """Return MuJoCo's Python package. Raises ValueError if it is not installed."""
    if importlib.util.find_spec("mujoco") is None:
        raise ValueError(f"MuJoCo is not installed: {EXTRA}")
    return importlib.import_module("mujoco")


def functions(mujoco: Any) -> list[int]:
    """Return the addresses of mj_step, mj_copyData and mju_user_warning. Raises ValueError."""
    folder = Path(mujoco.__file__).parent
    found = next(iter(sorted([*folder.glob("libmujoco.so*"), *folder.glob("libmujoco*.dylib")])), None)
    if found is None:
        raise ValueError(f"{folder} contains no library of MuJoCo: {EXTRA}")
    native = ctypes.CDLL(str(found))
    step, copy = (ctypes.cast(getattr(native, name), ctypes.c_void_p).value or 0 for name in ("mj_step", "mj_copyData"))
    return [step, copy, ctypes.addressof(ctypes.c_void_p.in_dll(native, "mju_user_warning"))]


def address_of(numbers: Any, index: int) -> int:
    """Return the address of a number of an array."""
    return numbers.ctypes.data + index * numbers.strides[0]


def files_of(path: Path) -> set[Path]:
    """Return an MJCF file and the existing files that it includes or refers to.

    A name counts from the folder of every file and from each folder that one names, because the files that a file
    includes use its folders.
    """
    found, unread = {path}, [path]
    folders: set[Path] = set()
    words: set[str] = set()
    while unread:
        file = unread.pop()
        folders.add(file.parent)
        words.update(FILES.findall(file.read_text(errors="replace")))
        places = folders | {folder / word for folder in folders for word in words if (folder / word).is_dir()}
        candidates = {Path(os.path.normpath(place / word)) for place in places for word in words}
        new = {candidate for candidate in candidates - found if candidate.is_file()}
        found |= new
        unread += [candidate for candidate in new if candidate.suffix == ".xml"]
    return found


def listed(names: Any) -> str:
    """Return names in a row, or "none"."""
    return ", ".join(filter(None, names)) or "none"


_RESERVED_NAMES = {name for name in dir(MujocoBody) if not name.startswith("_")} | set(MujocoBody.parameters)
