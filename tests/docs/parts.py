"""Page docs/hardware/parts.md: parts with prices, and two complete orders with their totals.

python -m tests.docs.parts
"""

from collections import Counter
from typing import NamedTuple

from tests.checkout import ROOT

PAGE = ROOT / "docs" / "hardware" / "parts.md"


class Part(NamedTuple):
    """A part that can be ordered.

    name : what it is; supplier, number : who sells it, and its number there
    mass : g, None if no public source states it
    price : "$112.21", "" if it is not public; date : date on which that price was read
    page : address of the product
    """

    name: str
    supplier: str
    number: str
    mass: int | None
    price: str
    date: str
    page: str


PARTS = {
    "pi": Part(
        "Raspberry Pi 4 Model B, 4 GB",
        "Electromaker, Mouser",
        "SC01949 (Mouser)",
        46,
        "$112.21",
        "2026-10-01",
        "https://www.raspberrypi.com/products/raspberry-pi-4-model-b/",
    ),
    "pi supply": Part(
        "supply 5.1 V, 3 A, USB-C",
        "Raspberry Pi",
        "KSA-15E-051300HU",
        None,
        "",
        "",
        "https://www.raspberrypi.com/products/type-c-power-supply/",
    ),
    "card": Part("microSD card, 32 GB", "", "", None, "", "", ""),
    "hat": Part(
        "CAN hat, two buses, MCP2518FD",
        "Waveshare",
        "17075",
        40,
        "$46.99",
        "2026-08-19",
        "https://www.waveshare.com/2-ch-can-fd-hat.htm",
    ),
    "one-bus hat": Part(
        "CAN hat, one bus, MCP2515", "Waveshare", "14882", None, "", "", "https://www.waveshare.com/rs485-can-hat.htm"
    ),
    "AK80-9": Part(
        "drive CubeMars AK80-9 V3.0, with a cable for power and CAN",
        "CubeMars",
        "AK80-9 V3.0 KV100",
        490,
        "$579.90",
        "2026-09-24",
        "https://www.cubemars.com/product/ak80-9-v3-0-robotic-actuator.html",
    ),
    "AK10-9": Part(
        "drive CubeMars AK10-9 V3.0",
        "CubeMars",
        "AK10-9 V3.0 KV60",
        940,
        "$798.90",
        "2026-09-24",
        "https://www.cubemars.com/product/ak10-9-v3-0-kv60-robotic-actuator.html",
    ),
    "AK45-10": Part(
        "drive CubeMars AK45-10, V2.0 board",
        "CubeMars",
        "AK45-10 KV75",
        260,
        "$155.90",
        "2026-09-24",
        "https://www.cubemars.com/product/AK45-10-robotic-actuatuor.html",
    ),
    "RS02": Part(
        "drive RobStride 02",
        "RobStride, Seeed",
        "RobStride 02",
        380,
        "$145.00",
        "2026-09-24",
        "https://robstride.com/products/robStride02",
    ),
    "RS03": Part(
        "drive RobStride 03",
        "RobStride, Seeed",
        "RobStride 03",
        880,
        "$225.00",
        "2026-09-24",
        "https://robstride.com/products/robStride03",
    ),
    "R-Link V3.0": Part(
        "adapter R-Link V3.0", "CubeMars", "RUBIK LINK V3.0", None, "$21.90", "2026", "https://store.cubemars.com/"
    ),
    "R-Link V2.0": Part(
        "adapter R-Link V2.0", "CubeMars", "RUBIK LINK V2.0", None, "$39.90", "2026", "https://store.cubemars.com/"
    ),
    "battery": Part("battery 24 V, 4 A·h, with adapter plate or plug", "", "", None, "", "", ""),
    "charger": Part("charger of that battery", "", "", None, "", "", ""),
    "stop": Part(
        "emergency stop, 40 mm, latching, normally closed",
        "Industry-Electronics",
        "Schneider XB5AS8442",
        None,
        "€31.04",
        "2026-06-02",
        "https://industry-electronics.com/schneider-electric/xb5as8442-mushroom-pushbuttons-nc-40mm-red-emergency-stop-drehentr.-kunst.d22mm-lieske_482705.htm",
    ),
    "contactor": Part(
        "contactor 100 A DC, coil 24 V",
        "DigiKey",
        "TE LEV100A5ANG",
        190,
        "€150.93",
        "2026",
        "https://www.digikey.it/it/products/detail/te-connectivity-aerospace-defense-and-marine/LEV100A5ANG/2362833",
    ),
    "main fuse holder": Part(
        "holder of the main fuse, MIDI, 58 V",
        "Mouser",
        "Littelfuse 04980921GXM5",
        None,
        "$8.97",
        "2026-06-02",
        "https://www.mouser.com/ProductDetail/Littelfuse/04980921GXM5",
    ),
    "main fuse": Part("main fuse, MIDI, rated for the wire", "", "Littelfuse 498 series", None, "", "", ""),
    "fuse": Part(
        "blade fuse 20 A, 32 V",
        "",
        "Littelfuse 0257020.PXPV",
        None,
        "",
        "",
        "https://media.digikey.com/pdf/Data%20Sheets/Littelfuse%20PDFs/257%20Series.pdf",
    ),
    "fuse holder": Part("holder of a blade fuse, with 12-gauge wire", "", "", None, "", "", ""),
    "buck": Part(
        "buck converter 5.5 to 50 V, to 5 V, 5.5 A",
        "Pololu",
        "4091 (D36V50F5)",
        None,
        "$39.95",
        "2026-09-13",
        "https://www.pololu.com/product/4091",
    ),
    "ICM-20948": Part(
        "IMU ICM-20948, I2C", "Adafruit", "4554", None, "$19.95", "2026-09-07", "https://www.adafruit.com/product/4554"
    ),
    "TCA9548A": Part("multiplexer TCA9548A", "Adafruit", "2717", None, "", "", "https://www.adafruit.com/product/2717"),
    "3DM-GX5": Part(
        "IMU MicroStrain 3DM-GX5-AHRS, with a USB cable",
        "Mouser",
        "3DM-GX5-AHRS",
        None,
        "",
        "",
        "https://www.microstrain.com/inertial-sensors/3dm-gx5-25",
    ),
    "OpenIMU": Part(
        "IMU Aceinna OpenIMU300RI", "Aceinna", "OpenIMU300RI", None, "", "", "https://openimu.readthedocs.io/"
    ),
    "Jetson": Part(
        "Jetson Orin Nano Super developer kit",
        "NVIDIA",
        "",
        176,
        "$250",
        "2026",
        "https://developer.nvidia.com/embedded/learn/get-started-jetson-orin-nano-devkit",
    ),
    "plug": Part("plug XT30 (2+2)", "AMASS", "XT30(2+2)-F.G.B", None, "", "", ""),
    "resistor": Part("resistor 120 Ω, 0.25 W", "", "", None, "", "", ""),
    "wire": Part("12-gauge wire in black and red, twisted pair for CAN, heat-shrink tubing", "", "", None, "", "", ""),
}
BENCH = Counter(
    ["pi", "pi supply", "card", "hat", "AK80-9", "R-Link V3.0", "battery", "charger", "stop", "contactor"]
    + ["main fuse holder", "main fuse", "fuse", "fuse holder", "resistor", "wire"]
)
ROBOT = Counter(
    [
        "pi",
        "card",
        "hat",
        "buck",
        *["AK80-9"] * 2,
        "R-Link V3.0",
        *["battery"] * 2,
        "charger",
        *["stop"] * 2,
        "contactor",
    ]
    + ["main fuse holder", "main fuse", *["fuse", "fuse holder"] * 3, *["ICM-20948"] * 2, "resistor", "wire"]
)
HEAD = """# Parts

Two complete orders, and the parts that can replace theirs. None of these parts has been tested with Tickwork. The
selection follows the part picker of the Epically Powerful project ([EP parts][EP parts]), which also links to a sheet
with suppliers.

* **Prices** are those that a public document read at the supplier on the date shown, in US dollars or euros, without
  tax and shipping. *ask*: no public price was found.
* **Mass** is the vendor's. A dash is a value that was not found.
* Totals contain the known values only, and state how many parts are missing in them.

`python -m tests.docs.parts` writes this page.
"""
COLUMNS = "| part | supplier | number | mass, g | price | read |\n|---|---|---|--:|--:|---|\n"
ORDER = "| quantity | part | number | mass, g | price |\n|--:|---|---|--:|--:|\n"
BENCH_TEXT = """\
The drive is clamped, the computer has a supply of its own, and the battery absorbs the energy that a braking drive
returns ([Power](power.md#energy-that-flows-back)). Add a lever with a load cell or spring scale to compare the torque,
a clamp or plate, and a multimeter. With a RobStride, the R-Link is not needed.
"""
ROBOT_TEXT = """\
Both drives and the computer run from one battery while the other is charged. The emergency stops of operator and wearer
are in series ([Power](power.md)). One fuse is for the computer. The two IMUs share one I2C bus, at 0x68 and
0x69 ([Sensors](sensors.md#mpu-9250-and-other-sensors-on-i2c)); a MicroStrain needs a USB socket instead.
"""
TAIL = """## The battery

Write the rig file and run `check` before you order a battery: it prints currents and times without any hardware. For
the knee exoskeleton of this repository, two AK10-9 with a proved torque of 12 N·m, it prints at most 9.1 A for each
drive, and 26 W on average in simulated walking with a load of 15 W ([example](../reference/rigs.md#battery)).
[Currents and energy](energy.md) has a line for each robot.

Blade fuses for cars are rated for 32 V: suitable for a battery of 24 V, not for one of 48 V. The coil of a contactor
must also pick up with an empty battery: compare its data sheet.

[EP parts]: https://github.com/gatech-epic-power/epically-powerful/blob/main/docs/source/pages/part_picker.md
"""


def page():
    """Return the text of the page."""
    listed = COLUMNS + "".join(map(row, PARTS.values()))
    orders = [
        f"## {title}\n\n{text}\n{order(quantities)}"
        for title, text, quantities in (
            ("A bench with one motor", BENCH_TEXT, BENCH),
            ("A robot with two joints", ROBOT_TEXT, ROBOT),
        )
    ]
    return "\n".join([HEAD, *orders, f"## All parts\n\n{listed}", TAIL])


def row(part):
    """Return the line of a part."""
    name = f"[{part.name}]({part.page})" if part.page else part.name
    cells = [name, part.supplier, part.number, dash(part.mass), part.price or "ask", part.date]
    return f"| {' | '.join(cells)} |\n"


def order(quantities):
    """Return the table of an order, with its totals."""
    lines = ORDER
    for key, quantity in quantities.items():
        part = PARTS[key]
        cost = f"{part.price[0]}{quantity * float(part.price[1:]):.2f}" if part.price else "ask"
        mass = dash(part.mass and quantity * part.mass)
        lines += f"| {quantity} | {part.name} | {part.number} | {mass} | {cost} |\n"
    return f"{lines}\n**Total:** {totals(quantities)}\n"


def totals(quantities):
    """Return the sums of the known masses and prices of an order."""
    costs, mass, asked, unknown = Counter(), 0, 0, 0
    for key, quantity in quantities.items():
        part = PARTS[key]
        costs[part.price[:1]] += quantity * float(part.price[1:] or 0.0)
        asked += not part.price
        mass += quantity * (part.mass or 0)
        unknown += part.mass is None
    known = " and ".join(f"{currency}{cost:.2f}" for currency, cost in costs.items() if currency)
    return f"{known}, without the {asked} parts to ask for; {mass} g, without the {unknown} parts of unknown mass."


def dash(value):
    """Return a number as text, a dash for None."""
    return "—" if value is None else f"{value:g}"


if __name__ == "__main__":
    PAGE.write_text(page())
