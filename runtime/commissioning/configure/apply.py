"""Carrying out what `configure` was asked of one drive: told before, agreed to, done, and read again."""

from blocks.actuators.cubemars import asking as mit
from blocks.actuators.robstride import asking, parameters
from runtime.commissioning.configure import cubemars
from runtime.commissioning.configure.robstride import Drive, NotPrivate, same
from runtime.commissioning.scan import refuse_company
from runtime.console.confirm import confirm
from runtime.console.terminal import tell

# of RobStride's MIT protocol: to the private one, from the next power on
SWITCH_BACK = b"\xff\xff\xff\xff\xff\xff\x00\xfd"


def carry_out(bus, wanted):
    """Returns whether everything was confirmed. BadInput

    bus : ToolBus
    wanted : namespace with can_id, reads (Parameters), writes (Parameter, value), zero, protocol, new_id, save, yes
    """
    if wanted.protocol == "private" and not (
        wanted.writes or wanted.zero or wanted.new_id or wanted.save or wanted.reads
    ):
        if (found := from_mit(bus, wanted)) is not None:
            return found
    try:
        drive = Drive(bus, wanted.can_id)
    except NotPrivate:
        if wanted.zero and not (wanted.reads or wanted.writes or wanted.protocol or wanted.new_id):
            found = cubemars.carry_out(bus, wanted)
            if found is not None:
                return found
        raise
    tell([f"id {drive.can_id} on {bus.bus.channel}, unique {drive.unique}"])
    show(drive, wanted.reads)
    if not (wanted.writes or wanted.zero or wanted.protocol or wanted.new_id or wanted.save):
        return True
    drive.refuse_running()
    drive.stop()
    check(drive, wanted)
    before = {parameter.name: drive.read(parameter.name) for parameter, _ in wanted.writes}
    position = drive.read("mechPos") if wanted.zero else None
    tell(planned(drive, wanted, before, position))
    if not confirm("change that", wanted.yes):
        tell(["nothing was changed"])
        return True
    return all(
        [
            *(write(drive, parameter, value, before[parameter.name]) for parameter, value in wanted.writes),
            not wanted.zero or zero(drive, position),
            not wanted.save or save(drive),
            not wanted.protocol or switch(drive, wanted.protocol),
            not wanted.new_id or rename(drive, wanted.new_id),
        ]
    )


def check(drive, wanted):
    """BadInput for what must not be sent to this drive."""
    if wanted.save:
        drive.need_robstride("--save")
    if wanted.protocol:
        drive.need_robstride(f"--protocol {wanted.protocol}")
    for parameter, _ in wanted.writes:
        if not parameter.cybergear:
            drive.need_robstride(f"--write {parameter.name}, which a CyberGear does not have")
    if wanted.new_id:
        drive.check_free(wanted.new_id)


def show(drive, reads):
    for parameter in reads:
        value = drive.read(parameter.name)
        tell([f"  {parameter.name:<14} {'-' if value is None else parameter.text(value):<14} {parameter.meaning}"])


def planned(drive, wanted, before, position):
    """Lines: what is, and what will be."""

    def now(value, parameter):
        return "not told" if value is None else parameter.text(value)

    lines = [
        f"  {parameter.name}: {now(before[parameter.name], parameter)} -> {parameter.text(value)}"
        for parameter, value in wanted.writes
    ]
    lines += [f"  position: {now(position, parameters.PARAMETERS['mechPos'])} -> 0 rad"] * bool(wanted.zero)
    lines += ["  saved: it is kept when its power goes"] * bool(wanted.save)
    lines += [f"  protocol: private -> {wanted.protocol}, from its next power on"] * bool(wanted.protocol)
    lines += [f"  id: {drive.can_id} -> {wanted.new_id}"] * bool(wanted.new_id)
    return lines


def write(drive, parameter, value, before):
    drive.bus.send(asking.write(parameter, value, drive.can_id), f"write {parameter.name}")
    drive.bus.listen(0.05)
    after = drive.read(parameter.name)
    fine = same(parameter, value, after)
    told = "not told" if after is None else parameter.text(after)
    tell(
        [
            f"done: {parameter.name} is {told}"
            if fine
            else f"NOT done: {parameter.name} is {told}, and not {parameter.text(value)}"
        ]
    )
    return fine


def zero(drive, before):
    drive.bus.send(asking.set_zero(drive.can_id), "set zero")
    drive.bus.listen(0.2)
    after = drive.read("mechPos")
    fine = after is not None and abs(after) < 0.01
    told = "not told" if after is None else f"{after:.4f} rad"
    tell([f"done: position is {told}" if fine else f"NOT done: position is {told}"])
    return fine


def save(drive):
    answer = drive.bus.ask(
        asking.save(drive.can_id),
        "save",
        lambda *frame: asking.feedback(*frame, drive.can_id),
        patience=0.5,
        attempts=1,
    )
    tell(
        ["done: saved" if answer else "saved, but the drive did not answer: turn its power off and on, and read again"]
    )
    return answer is not None


def switch(drive, name):
    drive.bus.send(asking.set_protocol(drive.can_id, name), "set protocol")
    drive.bus.listen(0.1)
    tell([f"sent: protocol {name}; it takes effect when its power has been off: then look with `scan`"])
    return True


def rename(drive, new):
    drive.bus.send(asking.set_id(drive.can_id, new), "set id")
    drive.bus.listen(0.2)
    after = drive.identities(new)
    fine = after == [drive.unique] and not drive.identities(drive.can_id)
    tell(
        [
            f"done: id {drive.can_id} is now {new}, unique {drive.unique}"
            if fine
            else f"NOT done: as id {new} answers {' and '.join(after) or 'nobody'}; look with `scan`"
        ]
    )
    return fine


def from_mit(bus, wanted):
    """Send a RobStride in its MIT protocol back to the private one; None where the id does not speak that."""
    refuse_company(bus)
    found = bus.ask(mit.question(wanted.can_id), "disable", lambda *frame: mit.answer(*frame, wanted.can_id))
    if found is None or found.family != mit.ROBSTRIDE_MIT:
        return None
    tell([f"  id {wanted.can_id}: protocol: mit -> private, from its next power on"])
    if not confirm("change that", wanted.yes):
        tell(["nothing was changed"])
        return True
    bus.send((wanted.can_id, False, SWITCH_BACK), "set protocol")
    bus.listen(0.1)
    tell(["sent: protocol private; it takes effect when its power has been off: then look with `scan`"])
    return True
