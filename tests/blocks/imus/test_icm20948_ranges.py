"""The ranges of an ICM-20948 scale its samples: they are read back from their bank, and another one is refused."""

import pytest

from blocks.imus import ICM20948

GYRO, ACCEL = 0x01, 0x14


@pytest.mark.parametrize("register, name", [(None, ""), (GYRO, "GYRO_CONFIG_1"), (ACCEL, "ACCEL_CONFIG")])
def test_a_range_that_differs_from_the_written_one_is_refused(register, name):
    imu = ICM20948(magnetometer=False, gyro_range=2000.0, accel_range=8.0)
    registers, bank = {}, [0]

    def write(step):
        for place, value in enumerate(step.data):
            if step.register == 0x7F:
                bank[0] = value
            elif (bank[0], step.register + place) != (0x20, register):
                registers[bank[0], step.register + place] = value

    for step in imu.set_up():
        write(step)

    def read(first, count, address=None):
        return bytes(registers.get((bank[0], first + place), 0) for place in range(count))

    if register is None:
        imu.learn(read, write)
        assert bank[0] == 0
        return
    with pytest.raises(ValueError, match=f"its register {name} reads 0x00, 0x.. was written"):
        imu.learn(read, write)
