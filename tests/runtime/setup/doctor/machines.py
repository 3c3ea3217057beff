"""Machines to look at: their files and what their commands print, in the formats of the real ones.

/proc/version of a Pi 4, a Jetson Orin Nano and a laptop: as printed in public logs of Raspberry Pi OS 12, JetPack
6.2 and Ubuntu 24.04 ip -details -json link: the iproute2 patches on linux-can (ES582.1), `ip -d link show can0` of
an Orin Nano in NVIDIA's forum nvpmodel.conf and nvpmodel -q: of an Orin Nano with JetPack 6.2
get_throttled: the firmware's driver in Raspberry Pi's kernel (hexadecimal, without 0x), its bits in the
documentation of vcgencmd /proc/self/limits, /proc/swaps, id, ls -l, cpuidle, cpufreq: as Linux and coreutils print
them
"""

import json
import os

LIMITS = """\
Limit                     Soft Limit           Hard Limit           Units
Max cpu time              unlimited            unlimited            seconds
Max locked memory         {memlock:<20} {memlock:<20} bytes
Max realtime priority     {rtprio:<20} {rtprio:<20}
Max realtime timeout      unlimited            unlimited            us
"""
SWAPS = "Filename\t\t\t\tType\t\tSize\t\tUsed\t\tPriority\n"
ORDINARY = "Name:\tpython\nCapEff:\t0000000000000000\n"


def can_link(name, bitrate=1_000_000, state="ERROR-ACTIVE", restart=0, errors=(0, 0), queue=10, chip="mcp251x", data=0):
    """One interface of `ip -details -json link`."""
    return {
        "ifindex": 3,
        "ifname": name,
        "flags": ["NOARP", "UP", "LOWER_UP", "ECHO"],
        "mtu": 16,
        "qdisc": "pfifo_fast",
        "operstate": "UP",
        "linkmode": "DEFAULT",
        "group": "default",
        "txqlen": queue,
        "link_type": "can",
        "promiscuity": 0,
        "min_mtu": 0,
        "max_mtu": 0,
        "linkinfo": {
            "info_kind": "can",
            "info_data": {
                "state": state,
                "berr_counter": {"tx": errors[0], "rx": errors[1]},
                "restart_ms": restart,
                "bittiming": {
                    "bitrate": bitrate,
                    "sample_point": "0.750",
                    "tq": 125,
                    "prop_seg": 2,
                    "phase_seg1": 3,
                    "phase_seg2": 2,
                    "sjw": 1,
                    "brp": 1,
                },
                **({"data_bittiming": {"bitrate": data}} if data else {}),
                "bittiming_const": {"name": chip, "tseg1": {"min": 3, "max": 16}, "tseg2": {"min": 2, "max": 8}},
                "clock": 8000000,
            },
        },
    }


LOOPBACK = {
    "ifindex": 1,
    "ifname": "lo",
    "flags": ["LOOPBACK", "UP", "LOWER_UP"],
    "mtu": 65536,
    "operstate": "UNKNOWN",
    "link_type": "loopback",
}


def ip(*links):
    return json.dumps([LOOPBACK, *links])


def processors(count, **files):
    """Files of each processor: content of cpu*/NAME, with double underscores as slashes."""
    folder = "/sys/devices/system/cpu/cpu"
    return {
        f"{folder}{number}/{name.replace('__', '/')}": text for number in range(count) for name, text in files.items()
    }


def idle(*states):
    """(name, µs) of the idle states of processor 0."""
    folder = "/sys/devices/system/cpu/cpu0/cpuidle/state"
    return {
        f"{folder}{index}/{key}": f"{value}\n"
        for index, (name, wake) in enumerate(states)
        for key, value in (("name", name), ("latency", wake), ("disable", 0))
    }


PI_4 = {
    "/proc/version": "Linux version 6.12.47+rpt-rpi-v8 (serge@raspberrypi.com) (aarch64-linux-gnu-gcc-12 (Debian "
    "12.2.0-14+deb12u1) "
    "12.2.0, GNU ld (GNU Binutils for Debian) 2.40) #1 SMP PREEMPT Debian 1:6.12.47-1+rpt1~bookworm "
    "(2025-09-16)\n",
    "/proc/device-tree/model": "Raspberry Pi 4 Model B Rev 1.5\0",
    "/proc/device-tree/compatible": "raspberrypi,4-model-b\0brcm,bcm2711\0",
    "/proc/cpuinfo": "processor\t: 0\nBogoMIPS\t: 108.00\nFeatures\t: fp asimd evtstrm crc32 cpuid\n"
    "Model\t\t: Raspberry Pi 4 Model B Rev 1.5\n",
    "/proc/sys/kernel/sched_rt_runtime_us": "950000\n",
    "/proc/sys/kernel/sched_rt_period_us": "1000000\n",
    "/proc/self/limits": LIMITS.format(memlock=8388608, rtprio=0),
    "/proc/self/status": ORDINARY,
    "/proc/self/cgroup": "0::/user.slice/user-1000.slice/session-3.scope\n",
    "/proc/swaps": SWAPS + "/var/swap                               file\t\t524284\t\t0\t\t-2\n",
    "/proc/1/comm": "systemd\n",
    "/etc/os-release": 'PRETTY_NAME="Debian GNU/Linux 12 (bookworm)"\nNAME="Debian '
    'GNU/Linux"\nVERSION_ID="12"\nID=debian\n',
    "/etc/group": "root:x:0:\nadm:x:4:pi\ndialout:x:20:pi\nsudo:x:27:pi\ngpio:x:995:pi\ni2c:x:994:pi\n"
    "spi:x:993:pi\npi:x:1000:\n",
    "/boot/firmware/config.txt": "dtparam=audio=on\n\n[cm4]\notg_mode=1\n\n[all]\ndtparam=i2c_arm=on\n",
    "/sys/devices/system/cpu/online": "0-3\n",
    "/sys/devices/system/cpu/isolated": "\n",
    "/sys/devices/system/clocksource/clocksource0/current_clocksource": "arch_sys_counter\n",
    "/sys/devices/system/clocksource/clocksource0/available_clocksource": "arch_sys_counter\n",
    "/sys/devices/platform/soc/soc:firmware/get_throttled": "50000\n",
    "/sys/class/i2c-adapter/i2c-1/of_node/clock-frequency": (100_000).to_bytes(4, "big"),
    "/sys/class/net/lo/type": "772\n",
    "/sys/class/net/can0/type": "280\n",
    "/sys/class/net/can0/operstate": "up\n",
    "/sys/class/net/can0/tx_queue_len": "10\n",
    "/sys/class/net/can0/device/driver": ("../../../../../../../bus/spi/drivers/mcp251x",),
    "/commands/ip -details -json link": ip(can_link("can0")),
    "/commands/id": "uid=1000(pi) gid=1000(pi) "
    "groups=1000(pi),4(adm),20(dialout),27(sudo),993(spi),994(i2c),995(gpio)\n",
    "/commands/uname -m": "aarch64\n",
    "/commands/getconf LONG_BIT": "64\n",
    "/commands/ls -l _dev": "total 0\n"
    "crw------- 1 root root     10, 261 Nov 21 09:12 cpu_dma_latency\n"
    "crw-rw---- 1 root i2c      89,   1 Nov 21 09:12 i2c-1\n"
    "lrwxrwxrwx 1 root root           5 Nov 21 09:12 serial0 -> ttyS0\n"
    "crw-rw---- 1 root dialout 204,  64 Nov 21 09:12 ttyAMA0\n"
    "crw--w---- 1 root tty       4,  64 Nov 21 09:12 ttyS0\n",
    **processors(4, cpufreq__scaling_governor="ondemand\n"),
}

ORIN_NANO = {
    "/proc/version": "Linux version 5.15.148-tegra (buildbrain@mobile-u64-6354-d6000) "
    "(aarch64-buildroot-linux-gnu-gcc.br_real "
    "(Buildroot 2022.08) 11.3.0, GNU ld (GNU Binutils) 2.38) #1 SMP PREEMPT Thu Sep 18 15:08:33 PDT "
    "2025\n",
    "/proc/device-tree/model": "NVIDIA Jetson Orin Nano Engineering Reference Developer Kit Super\0",
    "/proc/device-tree/compatible": "nvidia,p3768-0000+p3767-0005-super\0nvidia,p3767-0005\0nvidia,tegra234\0",
    "/proc/cpuinfo": "processor\t: 0\nBogoMIPS\t: 62.50\nFeatures\t: fp asimd evtstrm aes pmull sha1 sha2 crc32 "
    "atomics\n",
    "/proc/sys/kernel/sched_rt_runtime_us": "950000\n",
    "/proc/sys/kernel/sched_rt_period_us": "1000000\n",
    "/proc/self/limits": LIMITS.format(memlock=1000341504, rtprio=0),
    "/proc/self/status": ORDINARY,
    "/proc/self/cgroup": "11:cpu,cpuacct:/user.slice\n10:memory:/user.slice\n"
    "0::/user.slice/user-1000.slice/session-3.scope\n",
    "/proc/swaps": SWAPS
    + "".join(f"/dev/zram{n}                              partition\t634416\t\t0\t\t5\n" for n in range(6)),
    "/sys/fs/cgroup/cpu,cpuacct/user.slice/cpu.rt_runtime_us": "0\n",
    "/etc/nv_tegra_release": "# R36 (release), REVISION: 4.7, GCID: 42132812, BOARD: generic, EABI: aarch64, "
    "DATE: Thu Sep 18 22:54:44 UTC 2025\n",
    "/etc/nvpmodel.conf": "< PARAM TYPE=FILE NAME=CPU_ONLINE >\nCORE_1 /sys/devices/system/cpu/cpu1/online\n\n"
    "< POWER_MODEL ID=0 NAME=15W >\nCPU_ONLINE CORE_1 1\n< POWER_MODEL ID=1 NAME=25W >\n"
    "< POWER_MODEL ID=2 NAME=MAXN_SUPER >\n< POWER_MODEL ID=3 NAME=7W >\n\n< PM_CONFIG "
    "DEFAULT=1 >\n",
    "/etc/os-release": 'PRETTY_NAME="Ubuntu 22.04.5 LTS"\nNAME="Ubuntu"\nID=ubuntu\n',
    "/etc/group": "root:x:0:\ndialout:x:20:\ni2c:x:108:jetson\njetson:x:1000:\n",
    "/sys/devices/system/cpu/online": "0-5\n",
    "/sys/devices/system/cpu/isolated": "5\n",
    "/sys/devices/system/clocksource/clocksource0/current_clocksource": "arch_sys_counter\n",
    "/sys/class/net/can0/type": "280\n",
    "/sys/class/net/can0/operstate": "up\n",
    "/sys/class/net/can0/tx_queue_len": "10\n",
    "/sys/class/net/can0/device/driver": ("../../../bus/platform/drivers/mttcan",),
    "/commands/ip -details -json link": ip(can_link("can0", state="ERROR-PASSIVE", errors=(0, 127), chip="mttcan")),
    "/commands/id": "uid=1000(jetson) gid=1000(jetson) groups=1000(jetson)\n",
    "/commands/uname -m": "aarch64\n",
    "/commands/getconf LONG_BIT": "64\n",
    "/commands/nvpmodel -q": "NV Power Mode: 15W\n0\n",
    "/commands/ls -l _dev": "total 0\n"
    "crw------- 1 root root     10, 125 Nov 21 09:12 cpu_dma_latency\n"
    "crw-rw---- 1 root i2c      89,   1 Nov 21 09:12 i2c-1\n"
    "crw-rw---- 1 root i2c      89,   7 Nov 21 09:12 i2c-7\n"
    "crw-rw---- 1 root dialout 238,   1 Nov 21 09:12 ttyTHS1\n",
    **processors(
        6,
        cpufreq__scaling_governor="schedutil\n",
        cpufreq__scaling_min_freq="729600\n",
        cpufreq__scaling_max_freq="1510400\n",
    ),
    **idle(("WFI", 1), ("c7", 5000)),
}

LAPTOP = {
    "/proc/version": "Linux version 6.8.0-45-generic (buildd@lcy02-amd64-115) (x86_64-linux-gnu-gcc-13 (Ubuntu "
    "13.2.0-23ubuntu4) 13.2.0, "
    "GNU ld (GNU Binutils for Ubuntu) 2.42) #45-Ubuntu SMP PREEMPT_DYNAMIC Fri Aug 30 12:02:04 UTC "
    "2024\n",
    "/proc/cmdline": "BOOT_IMAGE=/vmlinuz-6.8.0-45-generic root=/dev/mapper/vg-root ro quiet splash vt.handoff=7\n",
    "/proc/cpuinfo": "processor\t: 0\nvendor_id\t: GenuineIntel\nflags\t\t: fpu vme de pse tsc msr constant_tsc "
    "nonstop_tsc vmx\n",
    "/proc/sys/kernel/sched_rt_runtime_us": "950000\n",
    "/proc/sys/kernel/sched_rt_period_us": "1000000\n",
    "/proc/self/limits": LIMITS.format(memlock="unlimited", rtprio=95),
    "/proc/self/status": ORDINARY,
    "/proc/self/cgroup": "0::/user.slice/user-1000.slice/session-2.scope\n",
    "/proc/swaps": SWAPS + "/swap.img                               file\t\t8388604\t\t0\t\t-2\n",
    "/proc/812/comm": "irqbalance\n",
    "/proc/913/comm": "ModemManager\n",
    "/boot/config-6.8.0-45-generic": "CONFIG_PREEMPT_BUILD=y\n# CONFIG_PREEMPT_NONE is not "
    "set\nCONFIG_PREEMPT_VOLUNTARY=y\n"
    "# CONFIG_PREEMPT is not set\nCONFIG_PREEMPT_DYNAMIC=y\n",
    "/etc/os-release": 'PRETTY_NAME="Ubuntu 24.04.1 LTS"\nNAME="Ubuntu"\nID=ubuntu\n',
    "/etc/group": "root:x:0:\ndialout:x:20:ada\nada:x:1000:\n",
    "/sys/class/dmi/id/sys_vendor": "LENOVO\n",
    "/sys/class/dmi/id/product_name": "20XW00FPGE\n",
    "/sys/class/dmi/id/product_version": "ThinkPad X1 Carbon Gen 9\n",
    "/sys/devices/system/cpu/online": "0-7\n",
    "/sys/devices/system/cpu/isolated": "\n",
    "/sys/devices/system/clocksource/clocksource0/current_clocksource": "hpet\n",
    "/sys/devices/system/clocksource/clocksource0/available_clocksource": "tsc hpet acpi_pm\n",
    "/sys/bus/usb-serial/devices/ttyUSB0/latency_timer": "16\n",
    "/sys/class/net/wlp0s20f3/type": "1\n",
    "/sys/class/net/can0/type": "280\n",
    "/sys/class/net/can0/operstate": "up\n",
    "/sys/class/net/can0/tx_queue_len": "128\n",
    "/sys/class/net/can0/device/driver": ("../../../../../../bus/usb/drivers/gs_usb",),
    "/sys/class/net/vcan0/type": "280\n",
    "/sys/class/net/vcan0/operstate": "unknown\n",
    "/commands/ip -details -json link": ip(
        can_link("can0", restart=100, queue=128, chip="gs_usb"),
        {
            "ifindex": 5,
            "ifname": "vcan0",
            "flags": ["NOARP", "UP", "LOWER_UP"],
            "link_type": "can",
            "linkinfo": {"info_kind": "vcan"},
        },
    ),
    "/commands/id": "uid=1000(ada) gid=1000(ada) groups=1000(ada)\n",
    "/commands/uname -m": "x86_64\n",
    "/commands/getconf LONG_BIT": "64\n",
    "/commands/ls -l _dev": "total 0\n"
    "crw------- 1 root root     10, 126 Nov 21 09:12 cpu_dma_latency\n"
    "crw-rw---- 1 root dialout 188,   0 Nov 21 10:40 ttyUSB0\n",
    **processors(8, cpufreq__scaling_governor="powersave\n"),
    **idle(("POLL", 0), ("C1_ACPI", 1), ("C2_ACPI", 127), ("C3_ACPI", 1048)),
}


def lay_out(folder, *trees):
    """Write a machine, or changes to one: texts and bytes as files, a tuple as a link to its first, None takes a file
    away.
    """
    for name, content in {name: content for tree in trees for name, content in tree.items()}.items():
        path = folder / name.lstrip("/")
        if content is None:
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(content, tuple):
            os.symlink(content[0], path)
        else:
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder
