"""The name of a vendor or model occurs only in the folder of its device family and in its kernels."""

import re
from functools import cache

import pytest

from blocks.families import families
from tests.checkout import PACKAGES, ROOT, tracked

# what no table lists: names of vendors, and older names of models
MORE = ("Aceinna", "CyberGear", "AKM", "EduLite", "Xiaomi")
TEMPLATES = ROOT / "runtime" / "setup" / "laboratory" / "templates"
PUBLIC = ("blocks/actuators/__init__.py", "blocks/imus/__init__.py")  # import paths


def names():
    """Every family, block, chip and model of this library."""
    found = {*MORE}
    for family in families():
        found |= {family.name} if re.fullmatch(r"\w+", family.name) else set()
        found |= {drive.block.__name__ for drive in family.drives} | {sensor.__name__ for sensor in family.sensors}
        found |= {model for table in family.tables for model in table.models}
        found |= {node.name for node in family.nodes} | {chip.block.__name__ for chip in family.chips if chip.block}
        found |= {name for chip in family.chips if chip.registers for name in chip.registers[1].values()}
    return sorted(found)


@cache
def homes():
    """Folders of the families, and of their kernels."""
    folders = {path.parent for path in (ROOT / "blocks").rglob("family.py")}
    return [*folders, ROOT / "cext" / "kernels" / "devices"]


@cache
def pattern():
    """Long names in any position, short ones as words; with or without a hyphen before digits."""
    spelt = {name: re.sub(r"[-_ ]?(?=\d)|-", "[-_ ]?", name) for name in names()}
    alternatives = (text if len(name) > 6 else rf"(?<![^\W_]){text}(?![^\W_])" for name, text in spelt.items())
    return re.compile("|".join(alternatives), re.IGNORECASE)


def plain(text):
    return re.sub("[-_ ]", "", text.lower())


@cache
def plain_names():
    return {plain(name) for name in names()}


def strangers(text, path):
    """Lines of a file outside the families that contain such a name."""
    squeezed = plain(text)
    if not any(name in squeezed for name in plain_names()):  # a search for fixed text is a hundred times as fast
        return []
    if path in PUBLIC:
        return [
            line
            for line in text.splitlines()
            if pattern().search(line) and not re.match(r'from |    \w+,$|    "', line)
        ]
    return [line for line in text.splitlines() if pattern().search(line)]


def test_no_vendor_or_model_is_named_outside_its_family():
    found = []
    for path in tracked():
        name = path.relative_to(ROOT)
        if path.suffix == ".stencils" or TEMPLATES in path.parents:  # machine code; and files of a laboratory
            continue
        if name.parts[0] in PACKAGES and not any(home in path.parents for home in homes()):
            found += [f"{name}: {line.strip()}" for line in strangers(path.read_text(), str(name))]
    assert found == []


@pytest.mark.parametrize(
    "line",
    ["from blocks.actuators.cubemars import models", "# as the AK80-9", "an MPU9250", "EmulatedRobStride", "RS 02"],
)
def test_name_is_recognised_in_any_position(line):
    assert strangers(line, "runtime/scan.py") == [line]


def test_similar_text_is_not_a_name():
    assert strangers("params02 = robs.stride, open_imus", "runtime/scan.py") == []
