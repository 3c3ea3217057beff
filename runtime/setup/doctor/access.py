"""Parts of the script of `doctor --script` that are written on request: access point, and remote desktop."""

from __future__ import annotations

from typing import TYPE_CHECKING

from runtime.host.machine.probe import PI

if TYPE_CHECKING:
    from runtime.host.machine.finding import Wants
    from runtime.host.machine.probe import Machine

HOTSPOT_FILE = "/etc/NetworkManager/system-connections/tickwork-hotspot.nmconnection"
VNC = """\
# Remote desktop: VNC on port 5900, with the name and password of a user of this computer. It needs an image with a
# desktop. A viewer takes processor time: close it before a robot is worn.
# Undo: sudo raspi-config nonint do_vnc 1
run raspi-config nonint do_vnc 0
"""
RDP = """\
# Remote desktop: RDP on port 3389, with the name and password of a user of this computer. Log out at the screen first:
# a user has one desktop. A viewer takes processor time: close it before a robot is worn.
# Undo: sudo systemctl disable --now xrdp
if ! command -v xrdp >/dev/null; then
    run apt-get update -q
    run apt-get install -y -q xrdp
fi
run systemctl enable --now xrdp
"""


def parts(machine: Machine, wants: Wants) -> list[str]:
    """Return the requested parts."""
    return [_hotspot(wants.hotspot)] * bool(wants.hotspot) + [_desktop(machine)] * wants.remote_desktop


def _hotspot(name: str) -> str:
    """Return the part for an access point. The script asks for the password and does not contain it.

    name : letters, digits, dots, hyphens and underscores, because it is not quoted
    """
    return f"""\
# Access point {name} on wlan0, from the next start on. wlan0 then joins no other network.
# Start it at once: sudo nmcli connection up tickwork-hotspot
# Undo, also to change the password: sudo nmcli connection delete tickwork-hotspot
hotspot={HOTSPOT_FILE}
if ! grep -qxF ssid={name} "$into$hotspot" 2>/dev/null; then
    echo "password for the access point {name}, 8 to 63 characters:" >&2
    terminal=$(stty -g 2>/dev/null) || terminal=
    if [ -n "$terminal" ]; then trap 'stty "$terminal"' EXIT; stty -echo; fi
    IFS= read -r password || true
    if [ -n "$terminal" ]; then stty "$terminal" && echo >&2; fi
    if ! printf %s "$password" | LC_ALL=C grep -qxE '[ -~]{{8,63}}'; then
        echo "the password must have 8 to 63 letters, digits and signs of ASCII: run this again" >&2
        exit 1
    fi
    (
        umask 077
        put "$hotspot" <<END
[connection]
id=tickwork-hotspot
type=wifi
interface-name=wlan0
autoconnect=true
autoconnect-priority=100

[wifi]
mode=ap
ssid={name}

[wifi-security]
key-mgmt=wpa-psk
proto=rsn
pairwise=ccmp
group=ccmp
psk=$(printf '%s' "$password" | sed 's/\\\\/&&/g; s/ /\\\\s/g')

[ipv4]
method=shared

[ipv6]
method=ignore
END
    )
    run nmcli connection reload
fi
"""


def _desktop(machine: Machine) -> str:
    return VNC if machine.kind == PI else RDP
