"""Result of a check, and the requirements for the machine."""

from dataclasses import dataclass, field

OK, WORSE, BAD, UNKNOWN = "ok", "worse", "bad", "unknown"
SEVERITY = (BAD, WORSE, UNKNOWN, OK)


@dataclass
class Finding:
    """Result of a check.

    name : subject of the check
    verdict : "ok"; "worse": a robot runs, but less well; "bad": it does not run, or must not; "unknown"
    found : observed state
    why : why it matters, in one sentence
    cure : remedy, in one line
    part : part of the script with the remedy, "" for none
    subject : what that part applies to: an interface, a group, a mode
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
    """Requirements for the machine.

    bitrate : bit/s of the CAN buses
    data_bitrate : bit/s of the data of CAN FD, 0 for classic CAN
    queue : frames in the queue of a CAN interface
    restart : ms until a CAN interface restarts after bus-off
    user : account that runs the robot; the calling one by default
    folder : folder of the recordings
    overlays : lines for a Raspberry Pi's config.txt, without `dtoverlay=`
    hotspot : name of the access point that the script configures; "" for none
    remote_desktop : whether the script enables a remote desktop
    """

    bitrate: int = 1_000_000
    data_bitrate: int = 0
    queue: int = 128
    restart: int = 100
    user: str | None = None
    folder: str = "recordings"
    overlays: list[str] = field(default_factory=list[str])
    hotspot: str = ""
    remote_desktop: bool = False
