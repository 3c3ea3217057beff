"""Runs the tests of real GPIO lines on an emulated machine whose kernel has the driver gpio-sim."""

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.hardware.test_gpio import REQUIRED
from tests.test_packaging import ROOT

HERE = Path(__file__).parent
KERNEL = Path(os.environ.get("TICKWORK_GPIO_KERNEL") or Path.home() / ".cache/tickwork/gpio-kernel")


@pytest.mark.soak
def test_real_gpio_lines_on_an_emulated_machine():
    if os.geteuid() != 0 or shutil.which("qemu-system-x86_64") is None or not (KERNEL / "vmlinuz").exists():
        pytest.skip(
            f"needs root, QEMU, and in {KERNEL} or $TICKWORK_GPIO_KERNEL a kernel with gpio-sim: sh "
            "tests/hardware/gpio_kernel.sh makes one"
        )
    if find_spec("gpiod") is None:
        pytest.skip("needs libgpiod's Python package: pip install 'tickwork[gpio]'")
    options = "-p no:cacheprovider -p no:hypothesispytest --color=no --tb=short -m '' -rP"
    command = f"{sys.executable} -m pytest {options} {os.path.relpath(HERE, ROOT)}/test_gpio.py"
    process = subprocess.run(
        ["sh", HERE / "gpio_machine.sh", KERNEL, command],
        cwd=ROOT,
        env={**os.environ, REQUIRED: "1"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=400,
    )
    assert process.returncode == 0, process.stdout[-8000:]
    assert " passed" in process.stdout and "skipped" not in process.stdout
    print("\n".join(line for line in process.stdout.splitlines() if line.startswith("edge to reader")))
