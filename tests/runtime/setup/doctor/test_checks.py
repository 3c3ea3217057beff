"""What the doctor finds on machines as they come from the shop, on strange ones, and on this one."""

import gzip
import os

import pytest

from runtime.host.machine.finding import BAD, OK, SEVERITY, UNKNOWN, WORSE, Wants
from runtime.host.machine.probe import Device, Machine
from runtime.setup.doctor import CHECKS, examine
from tests.runtime.setup.doctor.machines import LAPTOP, LIMITS, ORIN_NANO, PI_4, can_link, idle, ip, lay_out


@pytest.fixture
def look(tmp_path):
    """Findings about a machine and what was changed on it."""

    def look(*trees, **wants):
        number = len(list(tmp_path.iterdir()))
        return examine(Machine(lay_out(tmp_path / str(number), *trees)), Wants(**wants))

    (tmp_path / "0").mkdir()
    return look


def verdicts(findings):
    return {finding.name: finding.verdict for finding in findings if finding.name not in ("Python", "recordings")}


def one(findings, name):
    [finding] = [finding for finding in findings if finding.name == name]
    return finding.verdict, finding.found


def cure(findings, name):
    return next(finding.cure for finding in findings if finding.name == name)


def test_findings_on_a_raspberry_pi_4_with_a_can_hat(look):
    findings = look(PI_4)
    assert verdicts(findings) == {
        "preemption": OK,
        "real-time share": OK,
        "clock source": OK,
        "word size": OK,
        "processors": OK,
        "hardware": OK,
        "governor": WORSE,
        "idle states": OK,
        "sleep": OK,
        "throttling": WORSE,
        "swap": WORSE,
        "interrupts": OK,
        "rtprio": WORSE,
        "memlock": WORSE,
        "groups": OK,
        "can0": WORSE,
        "serial ports": OK,
        "I2C": OK,
        "I2C speed": WORSE,
    }
    assert one(findings, "hardware")[1] == "Raspberry Pi 4 Model B Rev 1.5"
    assert one(findings, "preemption")[1] == "preemptible (PREEMPT), not PREEMPT_RT"
    assert one(findings, "governor")[1] == "ondemand on 4 of 4 processors"
    assert one(findings, "throttling")[1] == "since the start: under-voltage, throttled (0x50000)"
    assert one(findings, "swap")[1] == "/var/swap"
    assert one(findings, "memlock")[1] == "the limit of pi is 8192 KiB"
    assert one(findings, "serial ports")[1] == "ttyAMA0"  # the console has ttyS0
    assert one(findings, "I2C speed")[1] == "100 kHz"
    assert [finding.found for finding in findings if finding.name == "can0"] == [
        "does not restart automatically",
        "transmit queue of 10 frames",
        "an MCP2515, which holds two frames",
    ]


def test_findings_on_a_new_jetson_with_a_sensor_at_another_bitrate(look):
    findings = look(ORIN_NANO)
    assert one(findings, "power mode") == (WORSE, "15W; MAXN_SUPER is available")
    assert cure(findings, "power mode") == "sudo nvpmodel -m 2"
    assert one(findings, "clocks") == (WORSE, "from 0.73 to 1.51 GHz")
    assert one(findings, "idle states") == (
        WORSE,
        "c7 takes 5000 µs to wake up, and jetson may not open /dev/cpu_dma_latency",
    )
    assert one(findings, "processors") == (OK, "6, isolated: 5")
    assert one(findings, "control group") == (WORSE, "/sys/fs/cgroup/cpu,cpuacct/user.slice/cpu.rt_runtime_us is 0")
    assert one(findings, "memlock") == (OK, "jetson may lock 954 MiB of memory")
    assert one(findings, "groups") == (WORSE, "jetson will be in i2c from the next login on")
    assert one(findings, "serial ports") == (BAD, "jetson may not use ttyTHS1 of group dialout")
    assert cure(findings, "serial ports") == "sudo usermod -aG dialout jetson, then log in again"
    assert one(findings, "I2C") == (BAD, "jetson may not use i2c-1, i2c-7 of group i2c")
    assert cure(findings, "I2C").startswith("log in again")
    assert [(finding.verdict, finding.found) for finding in findings if finding.name == "can0"][0] == (
        BAD,
        "ERROR-PASSIVE (0 errors sending, 127 receiving)",
    )
    assert "throttling" not in verdicts(findings)


def test_findings_on_a_laptop_with_a_usb_adapter(look):
    findings = look(LAPTOP)
    assert one(findings, "hardware") == (OK, "LENOVO ThinkPad X1 Carbon Gen 9")
    assert one(findings, "preemption") == (WORSE, "voluntary (PREEMPT_DYNAMIC)")
    assert cure(findings, "preemption") == (
        "add preempt=full to the kernel's command line, or better: sudo pro enable realtime-kernel"
    )
    assert one(findings, "clock source") == (WORSE, "hpet") and "clocksource=tsc" in cure(findings, "clock source")
    assert one(findings, "governor") == (WORSE, "powersave on 8 of 8 processors")
    assert one(findings, "idle states")[1].startswith("C3_ACPI takes 1048 µs")
    assert one(findings, "rtprio") == (OK, "ada may use priorities up to 95")
    assert one(findings, "swap") == (OK, "/swap.img; --realtime locks what a run needs")
    assert one(findings, "can0") == (OK, "1 Mbit/s, ERROR-ACTIVE, transmit queue of 128 frames, gs_usb")
    assert one(findings, "vcan0") == (OK, "virtual")
    assert one(findings, "serial latency") == (WORSE, "16 ms on ttyUSB0")
    assert one(findings, "modem manager")[0] == WORSE
    assert one(findings, "interrupts") == (OK, "balanced by irqbalance")


@pytest.mark.parametrize(
    "changes, found",
    [
        ({"/sys/kernel/realtime": "1\n"}, (OK, "PREEMPT_RT")),
        ({"/proc/version": "Linux version 6.1.0-rt7 (x) #1 SMP PREEMPT_RT Debian\n"}, (OK, "PREEMPT_RT")),
        ({"/proc/version": "Linux version 4.9.201-rt134-tegra (x) #1 SMP PREEMPT RT Mon\n"}, (OK, "PREEMPT_RT")),
        ({"/proc/version": "Linux version 5.10.0 (x) #1 SMP Debian\n"}, (WORSE, "the kernel is not preemptible")),
        (
            {"/sys/kernel/debug/sched/preempt": "none voluntary (full)\n"},
            (OK, "preemptible (PREEMPT_DYNAMIC, full), not PREEMPT_RT"),
        ),
        ({"/proc/cmdline": "quiet preempt=full\n"}, (OK, "preemptible (PREEMPT_DYNAMIC, full), not PREEMPT_RT")),
        ({"/boot/config-6.8.0-45-generic": None}, (UNKNOWN, "PREEMPT_DYNAMIC, whose model only root can read")),
        (
            {"/boot/config-6.8.0-45-generic": None, "/proc/config.gz": gzip.compress(b"CONFIG_PREEMPT=y\n")},
            (OK, "preemptible (PREEMPT_DYNAMIC, full), not PREEMPT_RT"),
        ),
        ({"/proc/config.gz": b"no gzip"}, (WORSE, "voluntary (PREEMPT_DYNAMIC)")),
    ],
)
def test_preemption_models_are_detected(look, changes, found):
    assert one(look(LAPTOP, changes), "preemption") == found


@pytest.mark.parametrize(
    "runtime, verdict, found",
    [
        ("-1", OK, "unlimited; a run removes the priority of a loop that hangs"),
        ("0", BAD, "none"),
        ("500000", WORSE, "50 % of the time"),
    ],
)
def test_real_time_shares_are_checked(look, runtime, verdict, found):
    assert one(look(PI_4, {"/proc/sys/kernel/sched_rt_runtime_us": runtime}), "real-time share") == (verdict, found)


@pytest.mark.parametrize(
    "machine, bits, found",
    [
        ("aarch64", "32", (BAD, "32-bit programs on a 64-bit kernel (aarch64)")),
        ("armv7l", "32", (BAD, "32-bit programs (armv7l)")),
    ],
)
def test_systems_of_32_bits_are_bad(look, machine, bits, found):
    findings = look(PI_4, {"/commands/uname -m": machine, "/commands/getconf LONG_BIT": bits})
    assert one(findings, "word size") == found and cure(findings, "word size") == "install the 64-bit Raspberry Pi OS"


@pytest.mark.parametrize(
    "changes, found",
    [
        ({"/sys/devices/platform/soc/soc:firmware/get_throttled": "0\n"}, (OK, "never since the start")),
        (
            {"/sys/devices/platform/soc/soc:firmware/get_throttled": "50005\n"},
            (BAD, "now: under-voltage, throttled (0x50005)"),
        ),
        (
            {
                "/sys/devices/platform/soc/soc:firmware/get_throttled": None,
                "/commands/vcgencmd get_throttled": "throttled=0x80008\n",
            },
            (BAD, "now: too hot (0x80008)"),
        ),
        (
            {"/sys/devices/platform/soc/soc:firmware/get_throttled": None},
            (UNKNOWN, "neither the firmware nor vcgencmd reports it"),
        ),
        (
            {"/sys/devices/platform/soc/soc:firmware/get_throttled": "?\n"},
            (UNKNOWN, "check failed: ValueError: invalid literal for int() with base 16: '?'"),
        ),
    ],
)
def test_voltage_and_temperature_of_a_pi_are_reported(look, changes, found):
    assert one(look(PI_4, changes), "throttling") == found


@pytest.mark.parametrize(
    "changes, mode",
    [
        ({"/commands/nvpmodel -q": "NV Power Mode: MAXN_SUPER\n2\n"}, (OK, "MAXN_SUPER")),
        (
            {"/commands/nvpmodel -q": None, "/var/lib/nvpmodel/status": "pmode:0003 fmode:quiet\n"},
            (WORSE, "7W; MAXN_SUPER is available"),
        ),
        ({"/etc/nvpmodel.conf": "< POWER_MODEL ID=0 NAME=15W >\n< POWER_MODEL ID=1 NAME=7W >\n"}, (OK, "15W")),
        ({"/etc/nvpmodel.conf": None}, (UNKNOWN, "not reported by nvpmodel")),
    ],
)
def test_power_modes_are_shown_by_name(look, changes, mode):
    assert one(look(ORIN_NANO, changes), "power mode") == mode


def test_locked_clocks_of_a_jetson_are_ok(look):
    findings = look(ORIN_NANO, {"/sys/devices/system/cpu/cpu0/cpufreq/scaling_min_freq": "1510400\n"})
    assert one(findings, "clocks") == (OK, "locked at 1.51 GHz")


def test_limits_privilege_and_the_idle_device_are_enough(look):
    """After `doctor --script` and a new login."""
    findings = look(
        PI_4,
        idle(("WFI", 1), ("deep", 900)),
        {
            "/proc/self/limits": LIMITS.format(memlock="unlimited", rtprio=90),
            "/commands/id": "uid=1000(pi) gid=1000(pi) groups=1000(pi),20(dialout),994(i2c),1001(realtime)\n",
            "/commands/ls -l _dev": "crw-rw---- 1 root realtime 10, 261 Nov 21 09:12 cpu_dma_latency\n",
        },
    )
    assert {name: one(findings, name)[0] for name in ("rtprio", "memlock", "swap", "idle states")} == dict.fromkeys(
        ("rtprio", "memlock", "swap", "idle states"), OK
    )
    findings = look(PI_4, {"/proc/self/status": "CapEff:\t0000000000804000\n"})  # CAP_SYS_NICE and CAP_IPC_LOCK
    assert (one(findings, "rtprio")[0], one(findings, "memlock")[0]) == (OK, OK)


@pytest.mark.parametrize(
    "link, troubles",
    [
        (can_link("can0", bitrate=500_000, restart=100), [(BAD, "500 kbit/s, not 1 Mbit/s")]),
        (
            can_link("can0", state="BUS-OFF", errors=(248, 0), restart=100),
            [(BAD, "BUS-OFF (248 errors sending, 0 receiving)")],
        ),
        (
            can_link("can0", state="ERROR-WARNING", restart=100),
            [(WORSE, "ERROR-WARNING (0 errors sending, 0 receiving)")],
        ),
        (None, [(UNKNOWN, "its bitrate is unknown")]),
        ({"ifname": "can0", "linkinfo": {"info_kind": "can"}}, [(UNKNOWN, "its bitrate is unknown")]),
        ({"ifname": "can0"}, [(UNKNOWN, "its bitrate is unknown")]),
    ],
)
def test_problems_of_a_can_interface_are_reported(look, link, troubles):
    findings = look(LAPTOP, {"/commands/ip -details -json link": ip(link) if link else None})
    assert [(finding.verdict, finding.found) for finding in findings if finding.name == "can0"] == troubles


@pytest.mark.parametrize(
    "data, found",
    [
        (0, "classic CAN, not CAN FD at 5 Mbit/s"),
        (2_000_000, "sends data of CAN FD at 2 Mbit/s, not CAN FD at 5 Mbit/s"),
        (5_000_000, None),
    ],
)
def test_an_interface_needs_the_requested_bitrate_of_the_data_of_can_fd(look, data, found):
    link = {"/commands/ip -details -json link": ip(can_link("can0", restart=100, queue=128, data=data))}
    finding = one(look(LAPTOP, link, data_bitrate=5_000_000), "can0")
    assert (finding[0], finding[1] if found else None) == ((BAD, found) if found else (OK, None))


def test_can_interface_that_is_down_has_one_problem_and_remedy(look):
    findings = look(PI_4, {"/sys/class/net/can0/operstate": "down\n"}, bitrate=500_000)
    assert one(findings, "can0") == (BAD, "is down")
    assert cure(findings, "can0") == (
        "sudo ip link set can0 type can bitrate 500000 restart-ms 100 && sudo ip link set can0 txqueuelen 128 up"
    )


def test_other_bitrate_is_accepted_if_requested(look):
    link = {"/commands/ip -details -json link": ip(can_link("can0", bitrate=500_000, restart=100, queue=128))}
    assert one(look(LAPTOP, link, bitrate=500_000), "can0")[0] == OK


def test_robot_computer_without_can_is_reported_with_remedy(look):
    gone = {name: None for name in (*PI_4, *ORIN_NANO) if "/net/can0" in name}
    assert "dtoverlay=" in cure(look(PI_4, gone), "CAN")
    assert "modprobe mttcan" in cure(look(ORIN_NANO, gone), "CAN")
    gone = {name: None for name in LAPTOP if "can0" in name}
    assert one(look(LAPTOP, gone), "CAN") == (OK, "no interface; a simulation needs none")


def test_permissions_of_owner_group_and_others_are_checked(tmp_path):
    folder = lay_out(
        tmp_path,
        PI_4,
        {
            "/commands/ls -l _dev": (
                "crw------- 1 pi   root 89, 1 Nov 21 09:12 i2c-1\ncrw-rw---- 1 root spi 89, 2 Nov 21 09:12 i2c-2\n"
                "crw-rw-rw-+ 1 root root 89, 3 Nov 21 09:12 i2c-3\ncrw-r----- 1 root spi 89, 4 Nov 21 09:12 i2c-4\n"
                "brw-rw-rw- 1 root disk 8, 0 Nov 21 09:12 i2c-5\n"
            )
        },
    )
    assert Machine(folder).devices("i2c-*") == [
        Device("i2c-1", "root", True),
        Device("i2c-2", "spi", True),
        Device("i2c-3", "root", True),
        Device("i2c-4", "spi", False),
    ]


def test_findings_on_a_machine_without_any_data(look):
    """Every check returns a result or reports that it cannot."""
    findings = look({})
    assert {finding.verdict for finding in findings} <= {OK, UNKNOWN, WORSE}
    assert {"preemption", "real-time share", "clock source", "word size", "processors", "rtprio", "groups"} <= {
        finding.name for finding in findings if finding.verdict == UNKNOWN
    }


@pytest.mark.parametrize("noise", [b"", b"\xff\xfe\0\n", b"(((", b"0", b"-1\n", b"[]", b"{}", b"a:b\nc", b"uid="])
def test_files_with_random_content_raise_no_exception(look, noise):
    for tree in (PI_4, ORIN_NANO, LAPTOP):
        findings = look({name: content if isinstance(content, tuple) else noise for name, content in tree.items()})
        assert all(finding.verdict in SEVERITY and finding.found for finding in findings)


def test_a_folder_in_place_of_a_system_file_raises_no_exception(look):
    findings = look({f"{name}/inside": b"" for name, content in PI_4.items() if not isinstance(content, tuple)})
    assert all(finding.verdict in SEVERITY for finding in findings)


def test_recordings_need_a_folder_that_can_be_written_and_room(look, tmp_path):
    assert one(look(PI_4, folder=str(tmp_path / "new" / "runs")), "recordings")[1].endswith(f" GiB free in {tmp_path}")
    assert one(look(PI_4, folder="/proc/runs"), "recordings")[0] == BAD
    assert one(look(PI_4, folder="/dev/null/runs"), "recordings") == (BAD, "cannot write to /dev/null")


def test_every_problem_has_reason_and_remedy(look):
    for finding in (finding for tree in (PI_4, ORIN_NANO, LAPTOP) for finding in look(tree)):
        if finding.verdict in (WORSE, BAD):
            assert finding.why and finding.cure and not finding.why.endswith("."), finding
        assert "\n" not in finding.found + finding.why + finding.cure


def test_doctor_examines_this_machine():
    findings = examine(Machine(), Wants())
    assert {"preemption", "clock source", "Python", "rtprio"} <= {finding.name for finding in findings}
    assert one(findings, "word size")[0] == OK and one(findings, "clock source")[0] != UNKNOWN
    assert not [finding for finding in findings if "check failed:" in finding.found]
    assert Machine().kernel == os.uname().release
    assert len(CHECKS) > 20
