"""Which processor a loop takes, and that no other loop of the machine takes the same."""

import os
from contextlib import closing

import pytest

from runtime.host.machine.processor import Processor, fastest_first

FAR = 5000  # no run of this machine takes such a number


def test_two_loops_use_two_processors_and_a_third_shares_the_fastest():
    with closing(Processor([FAR + 1, FAR])) as first:
        second = Processor([FAR + 1, FAR])
        with closing(second), closing(Processor([FAR + 1, FAR])) as third:
            assert (first.number, second.number, third.number) == (FAR + 1, FAR, FAR + 1)
            assert (first.shared, second.shared, third.shared) == (False, False, True)
        with closing(Processor([FAR + 1, FAR])) as again:
            assert again.number == FAR  # what the second has left
    with closing(Processor([FAR + 1, FAR])) as last:
        assert last.number == FAR + 1


def test_the_descriptor_of_a_processor_is_not_closed_for_a_file_that_has_taken_its_number(tmp_path):
    processor = Processor([FAR])
    number = processor._name.fileno()
    with open(tmp_path / "other", "w") as other:
        os.dup2(other.fileno(), number)
    processor.close()
    os.close(number)
    processor.close()  # it does nothing more


@pytest.mark.parametrize(
    "speeds, order",
    [
        ({}, [3, 2, 1, 0]),  # a virtual machine
        ({0: "1500000\n", 1: "1500000\n", 2: "1500000\n", 3: "1500000\n"}, [3, 2, 1, 0]),  # a Raspberry Pi
        # a laptop, whose last ones are the slow ones
        ({0: "4700000\n", 1: "4700000\n", 2: "3500000\n", 3: "3500000\n"}, [1, 0, 3, 2]),
    ],
)
def test_the_last_of_the_fastest_is_the_best(speeds, order):
    def text_of(path):
        number = int(path.removeprefix("/sys/devices/system/cpu/cpu").removesuffix("/cpufreq/cpuinfo_max_freq"))
        return speeds.get(number, "")

    assert fastest_first({0, 1, 2, 3}, text_of) == order
