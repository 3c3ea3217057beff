"""A character device in user space, by the protocol of the kernel's CUSE: requests are read from /dev/cuse, answers
written there.

An ioctl of any kind is served: where it points to memory that the kernel cannot know of, it is asked again with what
that needs (<linux/fuse.h>: CUSE_INIT, OPEN, IOCTL with FUSE_IOCTL_UNRESTRICTED, RELEASE).
"""

import errno
import os
import select
import struct

IN = struct.Struct("=IIQQIIII")  # length, opcode, unique, node, user, group, process, padding
OUT = struct.Struct("=IiQ")  # length, error, unique
CUSE_INIT = 4096
CUSE_INIT_IN, CUSE_INIT_OUT = struct.Struct("=IIII"), struct.Struct("=8I40x")
OPEN, RELEASE, FLUSH, INTERRUPT, IOCTL = 14, 18, 25, 36, 39
OPEN_OUT = struct.Struct("=QII")
IOCTL_IN, IOCTL_OUT, VECTOR = struct.Struct("=QIIQII"), struct.Struct("=iIII"), struct.Struct("=QQ")
UNRESTRICTED_IOCTL, RETRY = 1, 1 << 2
TRANSFER_LIMIT = 1 << 16


class Memory(Exception):
    """What an ioctl needs of its caller's memory, as (address, length) each. reads : before it can be told; writes :
    for its answer
    """

    def __init__(self, reads, writes=()):
        super().__init__(reads, writes)
        self.reads, self.writes = reads, writes


class CharacterDevice:
    """/dev/`name` until it is closed. `ioctl(number, argument, data, room)` returns the bytes of the answer, the `room`
    that was asked for.

    data : what the memory asked for holds, b"" at first; it raises Memory for more of it, and OSError for an errno
    """

    def __init__(self, name, ioctl):
        self.ioctl = ioctl
        self.fd = os.open("/dev/cuse", os.O_RDWR | os.O_CLOEXEC)
        opcode, unique, body = self.request()
        assert opcode == CUSE_INIT
        major, minor, _, _ = CUSE_INIT_IN.unpack_from(body)
        self.answer(
            unique,
            CUSE_INIT_OUT.pack(major, minor, 0, UNRESTRICTED_IOCTL, TRANSFER_LIMIT, TRANSFER_LIMIT, 0, 0)
            + f"DEVNAME={name}\0".encode(),
        )

    def close(self):
        os.close(self.fd)

    def request(self):
        data = os.read(self.fd, 2 * TRANSFER_LIMIT)
        length, opcode, unique, *_ = IN.unpack_from(data)
        return opcode, unique, data[IN.size : length]

    def answer(self, unique, data=b"", error=0):
        os.write(self.fd, OUT.pack(OUT.size + len(data), -error, unique) + data)

    def serve(self, other):
        """Until `other`, a descriptor, has something to read."""
        while True:
            ready, _, _ = select.select([self.fd, other], [], [])
            if self.fd in ready:
                self.one()
            if other in ready:
                return

    def one(self):
        opcode, unique, body = self.request()
        if opcode == OPEN:
            self.answer(unique, OPEN_OUT.pack(1, 0, 0))
        elif opcode in (RELEASE, FLUSH):
            self.answer(unique)
        elif opcode == IOCTL:
            self.control(unique, body)
        elif opcode != INTERRUPT:
            self.answer(unique, error=errno.ENOSYS)

    def control(self, unique, body):
        _, _, number, argument, size, room = IOCTL_IN.unpack_from(body)
        try:
            said = IOCTL_OUT.pack(0, 0, 0, 0) + self.ioctl(
                number, argument, body[IOCTL_IN.size : IOCTL_IN.size + size], room
            )
        except Memory as memory:
            vectors = (*memory.reads, *memory.writes)
            said = IOCTL_OUT.pack(0, RETRY, len(memory.reads), len(memory.writes)) + b"".join(
                VECTOR.pack(*one) for one in vectors
            )
        except OSError as error:
            self.answer(unique, error=error.errno)
            return
        self.answer(unique, said)
