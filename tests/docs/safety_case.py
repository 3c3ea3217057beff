"""Page docs/safety_case.md: each hazard, its measures, and the tests that show them.

python -m tests.docs.safety_case

A test shows a measure with the mark @pytest.mark.hazard("H1a"). The marks are read from the source, without importing
the tests.
"""

import ast
import functools
import textwrap
from pathlib import Path

from tests.checkout import ROOT

PAGE = ROOT / "docs" / "safety_case.md"
HEAD, TAIL = (Path(__file__).parent / f"safety_case_{part}.md" for part in ("head", "tail"))

HAZARDS = {  # hazard: (title, possible harm, {measure: text})
    "H1": (
        "The torque is higher than intended",
        "Injury of a joint, a fall.",
        {
            "a": "A diagram compiles only if every torque command lies within the limit of its actuator, over the "
            "ranges that its blocks declare.",
            "b": "A drive's encoder rejects a command beyond the limit, and no frame of that tick is sent.",
            "c": "Where the drive closes the loop, its stiffness and damping are reduced so that its whole law stays "
            "within the limit, for accelerations up to `max_acceleration`, replies up to `max_transit` late, and "
            "commands up to one period later than those before. Later replies, or an angle that cannot have come from "
            "motion, remove stiffness and damping.",
            "d": "Acceleration beyond that removes stiffness and damping, and ends the run if it persists.",
            "e": "A measured torque beyond the limit and its accuracy ends the run.",
            "f": "A drive whose range of position, velocity or torque differs from the table ends the run, as far as "
            "its measurements show it.",
            "g": "A change of a live parameter stays within the bounds of the proof and the rules between parameters, "
            "at each tick of a ramp and whichever process requests it. The output that a disabled limiter holds "
            "follows its limit, and `check` names each torque that a disabled subsystem holds and that reaches an "
            "actuator.",
            "h": "A setting that differs from the table of its drive and may scale the torque, and a mode in which "
            "nothing limits it, are warnings of `check`. No robot is armed with one that the operator has not accepted "
            "by its name.",
            "i": "The settings of a RobStride on which its limits rest are read back before it is enabled. CubeMars "
            "boards cannot be read; `check` and the table before arming state it.",
            "j": "A torque above 5 % of the rated torque without a command, before or during a run, ends it after "
            "60 ms.",
            "k": "A page of the panel changes nothing but live parameters inside their bounds, and one page at a time. "
            "Other messages are refused and counted.",
            "l": "The caps of a subject file are the smaller limit wherever a limit reaches native code. No diagram, "
            "subclass, setting, live change or second arming raises them; a mode whose torque nothing bounds is "
            "refused.",
            "m": "The guardian reads the torque in the frames of a capped actuator. A command above the cap is not "
            "sent where the guardian carries the bus, and a measured torque above it and its accuracy ends the run.",
            "o": "A run with a subject file is armed on a rig only if each actuator and inertial sensor has a record "
            "of commissioning that is fresh and complete, fits its block and the unit that responds, and has no "
            "findings, or if the operator accepts its absence by name.",
            "n": "A session ends after the time of the subject file, with a ramp of the commands.",
        },
    ),
    "H2": (
        "A torque is computed from invalid numbers",
        "Full torque in an arbitrary direction.",
        {
            "a": "NaN or infinity at an actuator ends the run, and is never sent.",
            "b": "A limiter returns NaN for NaN, not one of its limits.",
            "c": "One rejected command blocks the frames of all drives in that tick.",
        },
    ),
    "H3": (
        "The torque changes suddenly",
        "A stumble, pain.",
        {
            "a": "Commands fade in after arming.",
            "b": "A live parameter ramps to its new value.",
            "c": "A limiter bounds the rate of change of a torque.",
        },
    ),
    "H4": (
        "The robot moves unexpectedly",
        "A fall, crushed fingers.",
        {
            "a": "After all devices have responded, torque stays zero until the operator confirms the measurements. A "
            "key that was pressed before the question has no effect, however late it is delivered.",
            "b": "Without a terminal for that confirmation, a run on a robot is rejected before anything is sent.",
            "c": "On a robot, no frame that enables a drive or commands a torque is sent before every device, an "
            "emergency stop among them, has responded and the operator has confirmed, and after a fault not before a "
            "new confirmation. A drive that was power-cycled in a run and returns disabled has no torque afterwards; "
            "one that obeys without being enabled, if it was silent for `restart_time` and two periods from the first "
            "command without a reply, or reports its restart. An adapter whose bursts could hide such a silence is "
            "refused before any torque.",
            "d": "A run that was suspended and continues, or whose computer was suspended, sends no torque.",
            "e": "A bus has one controller: a second run is rejected.",
            "f": "A computer that can sleep is kept awake during a run, or the run prints why not.",
            "g": "No page of the panel arms a robot or a drive.",
            "h": "Where a lost page is a stop, no drive is enabled before a page has the controls, at the start and "
            "after a fault.",
            "i": "`commission` enables a drive only in a run with a guardian and at most 5 % of the rated torque, "
            "after the steps without torque have found nothing, and leaves it disabled however the command ends.",
        },
    ),
    "H5": (
        "The joint angle is wrong",
        "Torque in the wrong direction, a joint moved beyond its anatomical range.",
        {
            "a": "Every joint needs a range before a run on a robot.",
            "b": "A joint whose angle is ambiguous after power-up is not armed.",
            "c": "A joint outside its range ends the run.",
            "d": "A setpoint outside the range, such as degrees entered as radians, is an error before the run.",
            "e": "An angle that changes by more than motion can explain, such as a motor turn, ends the run.",
            "f": "Two drives with one id are not armed. A second one that appears in a run ends it.",
        },
    ),
    "H6": (
        "A drive fails",
        "Loss of support on one side, a fall.",
        {
            "a": "A drive that does not reply ends the run.",
            "b": "A fault that a drive reports ends the run.",
            "c": "A drive that does not follow its commands ends the run.",
            "d": "Any of these stops every drive on every bus within two ticks.",
        },
    ),
    "H7": (
        "The bus fails, or carries frames of another controller",
        "Drives hold their last command, or follow another program.",
        {
            "a": "A bus that is off, or an adapter that is unplugged, ends the run.",
            "b": "The stop reaches the drives of the other buses.",
            "c": "A node that floods the bus does not delay a tick.",
            "d": "Commands of another controller end the run.",
        },
    ),
    "H8": (
        "The control program fails",
        "Drives hold their last command.",
        {
            "a": "An exception in any block ends in the safe stop within its tick.",
            "b": "A block that hangs is stopped by the watchdog, which has the devices to itself before it sends.",
            "c": "The guardian stops the motors after a crash of the process.",
            "d": "The guardian stops the motors after the death of the process (`kill -9`).",
            "e": "The guardian stops the motors if the loop stalls or is suspended. A loop that was held within a send "
            "adds at most that batch, and the stop is repeated after it.",
            "f": "Nothing is armed without the guardian, and a run ends if it dies.",
            "g": "Where control process and guardian both die, or the computer loses its power, the time-out in the "
            "drive or a relay stops it. `check` and the table before arming list the drives with neither.",
        },
    ),
    "H9": (
        "The robot cannot be stopped",
        "Any of the above lasts longer.",
        {
            "a": "Ctrl-C, a closed terminal and every signal end in the safe stop.",
            "b": "The space bar ends in the safe stop, even while the recorder is stopped or dead, the queue of "
            "requests is full, or the terminal accepts no output.",
            "c": "A press of the emergency-stop button, or its silence, ends the run before another command is sent. "
            "Two senders with one id end it too, because each would hide the silence of the other.",
            "d": "The stop is repeated until each drive has confirmed it: by torque or current near zero and, where it "
            "reports it, its disabled state, in as many replies as were asked for. Drives that have not confirmed "
            "after 200 ms are named, and their frames continue, even if a terminal accepts no output, or if a new run "
            "that has taken the bus over is stopped before it arms.",
            "e": "Where the network is not the robot's own, the button signs its frames. Others, changed ones and "
            "recorded ones do not count.",
            "f": "Each page of the panel stops the run, whatever else it may do. The death of the panel does not end "
            "the run, unless the diagram demands a page; it is reported.",
            "g": "A page whose link is lost reports within half a second that its values are old and that it cannot "
            "stop the robot.",
            "h": "Where the diagram demands a page, its loss is a stop within 200 ms: closed, cut off, held up on its "
            "way, frozen, its browser paused, the controls given back or taken by another page, its panel paused or "
            "dead. A page in the background is not lost.",
        },
    ),
    "H10": (
        "A joint becomes free and the wearer falls",
        "A fall.",
        {
            "a": "A joint may be damped in the safe stop, within its torque limit at every speed.",
            "b": "The damping is applied by the guardian as well, if the control process has died.",
            "c": "A fuse or a battery that is too small for the limits is reported before the run.",
        },
    ),
    "H11": (
        "A drive overheats",
        "Burns, damage.",
        {
            "a": "A hot drive is derated, and ends the run at its limit.",
            "b": "The RMS torque is compared with the rated torque.",
            "c": "A temperature sensor that is broken ends the run.",
        },
    ),
    "H12": (
        "The torque comes at the wrong moment of the gait",
        "A stumble.",
        {
            "a": "The torque ends within 300 ms when the wearer stands still.",
            "b": "Squats are not taken for walking.",
            "c": "A missing sample becomes NaN, and is not stored in an estimate.",
            "d": "A sensor that is unplugged ends the run.",
            "e": "Walking backward, stepping in place, turning on the spot, hopping and sitting down are not assisted "
            "by torques over a gait phase.",
            "f": "Sensors that are exchanged between the legs, upside down or turned end the run.",
            "g": "Weight on the foot of a prosthesis ends its swing: the knee is stiff again.",
        },
    ),
    "H13": (
        "The loop is late",
        "Delayed torque.",
        {
            "a": "Late ticks are skipped on a fixed grid, without a burst, and counted.",
            "b": "A policy ends the run after a given number of missed ticks.",
        },
    ),
    "H14": (
        "The supply damages a drive",
        "An unpredictable drive, fire.",
        {"a": "A battery above the supply range of a drive is rejected before anything is armed."},
    ),
    "H15": (
        "Data of a trial is lost or disclosed",
        "A trial that must be repeated, a breach of privacy.",
        {
            "a": "A recording is readable only by the account that made it.",
            "b": "After the death of the control process, every completed tick is on disk.",
            "c": "A page of the panel is for this computer and account alone, or needs a token of the run. Pages of "
            "other sites are refused.",
        },
    ),
    "H16": (
        "An optimiser chooses unsuitable parameters",
        "Discomfort, a stumble.",
        {
            "a": "Bounds outside those of the proof are rejected before anything is armed.",
            "b": "No ramp of the optimiser changes a parameter of --over by more than its largest step.",
            "c": "The operator confirms each change, unless the command was started without confirmations.",
            "d": "A measurement that is missing or is not a finite number restores the last accepted parameters.",
            "e": "Its death restores them, or moves towards them by a step. If it hangs, the stop is not delayed.",
            "f": "A parameter that the operator has changed meanwhile keeps its value.",
        },
    ),
}


@functools.cache
def shown():
    """Return {measure: [(file, test)]} of the marks in the source of the tests."""
    found = {}
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        text = path.read_text()
        if "mark.hazard(" not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            for decorator in getattr(node, "decorator_list", []):
                if isinstance(decorator, ast.Call) and ast.unparse(decorator.func) == "pytest.mark.hazard":
                    for argument in decorator.args:
                        found.setdefault(ast.literal_eval(argument), []).append(
                            (path.relative_to(ROOT).as_posix(), node.name)
                        )
    return found


def page():
    """Return the text of the page."""
    tests = {test for own in shown().values() for test in own}
    size = f"The page has {len(HAZARDS)} hazards, {len(shown())} measures and {len(tests)} tests.\n"
    return "\n".join([HEAD.read_text(), size, *map(section, HAZARDS), TAIL.read_text()])


def section(hazard):
    """Return the section of one hazard."""
    title, harm, measures = HAZARDS[hazard]
    items = "".join(item(f"{hazard}{letter}", text) for letter, text in measures.items())
    return f"## {hazard}. {title}\n\nPossible harm: {harm}\n\n{items}"


def item(measure, text):
    """Return the lines of one measure. The name of a test is a sentence."""
    tests = "".join(
        f"  * {name.removeprefix('test_').replace('_', ' ')}: `{file}`\n" for file, name in shown().get(measure, [])
    )
    lines = textwrap.fill(f"* **{measure}** {text} Shown by:", 120, subsequent_indent="  ")
    return f"{lines}\n{tests}"


if __name__ == "__main__":
    PAGE.write_text(page())
