"""What a check says."""

from dataclasses import dataclass, field

OK, WORSE, BAD, UNKNOWN = "ok", "worse", "bad", "unknown"
SEVERITY = (BAD, WORSE, UNKNOWN, OK)


@dataclass
class Finding:
    """
    name : what was looked at
    verdict : "ok"; "worse": a robot runs, but less well; "bad": it does not run, or must not; "unknown"
    found : what is there
    why : why it matters, in one sentence
    cure : what to change, in one line
    part : of the script that does so, "" if none does
    subject : what the part is about: an interface, a group, a mode
    """

    name: str
    verdict: str
    found: str
    why: str = ""
    cure: str = ""
    part: str = ""
    subject: str = ""


@dataclass
class Wants:
    """What a person wants of the machine.

    bitrate : bit/s of the CAN buses
    queue : frames that may wait in a CAN interface
    restart : ms after which a CAN interface comes back from bus-off
    user : who runs the robot; None: whoever asks
    folder : of the recordings
    overlays : lines for a Raspberry Pi's config.txt, behind `dtoverlay=`
    """

    bitrate: int = 1_000_000
    queue: int = 128
    restart: int = 100
    user: str | None = None
    folder: str = "recordings"
    overlays: list = field(default_factory=list)
