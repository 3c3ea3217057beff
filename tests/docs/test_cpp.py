"""C++ of the documentation, compiled with the functions of its framework that it calls. The sketches have own tests."""

import re
import shutil
import struct
import subprocess

import pytest

from tests.checkout import ROOT
from tests.docs.fences import fences
from tests.docs.pages import NAMES

pytestmark = pytest.mark.skipif(shutil.which("g++") is None, reason="needs a C++ compiler")
ESP32 = r"""
#pragma once
#include <cstdint>
#include <cstdio>
#include <cstring>
#define INPUT_PULLUP 5
#define LOW 0
#define HIGH 1
inline int level = LOW, delays = 0;
inline void pinMode(int pin, int mode) { if (pin != 4 || mode != INPUT_PULLUP) level = -1; }
inline int digitalRead(int) { return level; }
inline void delay(int time) { delays += time; }
inline struct {
    void begin(const char *, const char *) {}
    void setSleep(bool) {}
} WiFi;
struct WiFiUDP {
    void beginPacket(const char *address, int port) { printf("%s %d ", address, port); }
    void write(const uint8_t *data, size_t size) { while (size--) printf("%02x", *data++); }
    void endPacket() { printf("\n"); }
};
"""
PRESSED_LATER = r"""
#include "button.ino"
int main() {
    setup();
    for (int i = 0; i < 300; i++) { if (i == 290) level = HIGH; loop(); }
    return delays != 300 * 20;
}
"""
ROS2 = r"""
#include <algorithm>
#include <cstdio>
#include <vector>
namespace rclcpp { struct Time {}; struct Duration {}; }
namespace controller_interface { enum class return_type { OK, ERROR }; }
struct Interface {
    double value;
    double get_value() const { return value; }
    void set_value(double wanted) { value = wanted; }
};
struct ImpedanceController {
    std::vector<Interface> state_interfaces_{{0.1}, {0.5}}, command_interfaces_{{0.0}};
    controller_interface::return_type update(const rclcpp::Time &, const rclcpp::Duration &);
};
"""
ONCE = r"""
int main() {
    ImpedanceController controller;
    controller.update({}, {});
    printf("%g", controller.command_interfaces_[0].value);
}
"""


def output(folder, main, **headers):
    """Compile main.cpp with headers, {name: text}, and return what it prints."""
    for name, text in {"main.cpp": main, **headers}.items():
        (folder / name).write_text(text)
    command = ["g++", "-std=c++17", "-Wall", "-Werror", "-I", folder, folder / "main.cpp", "-o", folder / "main"]
    subprocess.run(command, check=True, timeout=60)
    return subprocess.run([folder / "main"], check=True, capture_output=True, text=True, timeout=10).stdout


def on_page(name):
    [found] = [fence.text for fence in fences(ROOT / name) if fence.language == "cpp"]
    return found


def test_every_page_with_cpp_is_here():
    assert {
        name for name in NAMES if re.search(r"^```(cpp|c\+\+|arduino)", (ROOT / name).read_text(), re.MULTILINE)
    } == {"docs/reference/emergency_stop.md", "docs/coming_from/ros2_control.md"}


def test_the_button_of_the_page_sends_frames_that_count_until_it_is_pressed(tmp_path):
    headers = {"WiFi.h": ESP32, "WiFiUdp.h": "", "button.ino": on_page("docs/reference/emergency_stop.md")}
    lines = output(tmp_path, PRESSED_LATER, **headers).splitlines()
    for number, line in enumerate(lines, 1):
        address, port, data = line.split()
        identifier, length, payload = struct.unpack("<IB3x8s", bytes.fromhex(data))
        assert (address, int(port), identifier, length) == ("192.168.4.1", 9871, 0x100, 2)
        assert payload[:2] == bytes([number % 256, 0x5A if number <= 290 else 0])
    assert len(lines) == 300


def test_the_controller_for_ros2_has_the_law_of_the_diagram(tmp_path):
    torque = float(output(tmp_path, ROS2 + on_page("docs/coming_from/ros2_control.md") + ONCE))
    assert torque == pytest.approx(20.0 * (0.3 - 0.1) - 1.0 * 0.5)
