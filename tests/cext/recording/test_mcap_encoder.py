"""The encoder of messages, beside the same messages encoded in Python."""

import random
from struct import Struct

from cext.memory.shared_state import RECORD_FRAME, RECORD_RECEIVED, RECORD_ROW
from cext.recording.mcap_encoder import Encoder
from cext.recording.ring_batch import Batch
from runtime.record.storage import messages
from runtime.record.storage.chunks import walk_messages
from runtime.record.storage.columns import Layout
from runtime.record.storage.format import Frame, row_struct
from runtime.record.storage.mcap_file import MESSAGE, MESSAGE_REST

PATHS = ["left/knee.position", "left/imu.gyro[0]", "left/imu.gyro[1]", "right/knee.position", "wave.y"]
SIGNALS = [{"path": path, "every": every} for path, every in zip(PATHS, (1, 3, 3, 1, 7))]
RATE, WALL, FIRST_TICK = 300.0, 1_700_000_000_000_000_000, 12_345
TICK, BUSES = 9, (5, 7)
PLACE = Struct("=QQ")


def records(seed, buses):
    dice = random.Random(seed)
    made = []
    for tick in range(60):
        if dice.random() < 0.9:
            made.append((RECORD_RECEIVED, dice.randrange(1 << 40).to_bytes(8, "little")))
        for _ in range(dice.randrange(5)):
            length = dice.choice([0, 1, 8, 12, 64])
            flags = [dice.random() < 0.3 for _ in range(7)]
            flags[3] = flags[3] or length > 8
            frame = Frame(
                dice.randrange(1 << 40), dice.randrange(1 << 29), *flags, dice.randrange(buses), dice.randbytes(length)
            )
            made.append((RECORD_FRAME, frame.pack()))
        values = [tick, dice.random(), *(dice.choice([dice.random(), float("nan"), -0.0]) for _ in PATHS)]
        made.append((RECORD_ROW, row_struct(len(PATHS)).pack(*values)))
    return made


def message(channel, log_time, data, sequence):
    return MESSAGE.pack(5, MESSAGE_REST + len(data), channel, sequence, log_time, log_time) + data


class Oracle:
    """The messages in Python."""

    def __init__(self, subsystems, buses):
        self.subsystems, self.buses = subsystems, buses
        self.drain = self.drained = self.order = self.first = 0
        self.group = {}
        self.messages = []

    def add(self, kind, payload):
        if kind == RECORD_FRAME:
            frame = Frame.unpack(payload)
            if self.order == 0:
                self.first = self.drained if self.drain else frame.time
            order = self.order if self.buses > 1 else None
            encoded = messages.frame(frame.time, frame.id, frame.truths, frame.data, order)
            self.group.setdefault(frame.bus, []).append(encoded)
            self.order += 1
            return
        self.end_group()
        if kind == RECORD_RECEIVED:
            self.drain, self.drained = self.drain + 1, int.from_bytes(payload, "little")
            return
        tick, lateness, *values = row_struct(len(PATHS)).unpack(payload)
        at = WALL + FIRST_TICK + round(tick / RATE * 1e9)
        for channel, subsystem in enumerate(self.subsystems, 1):
            if tick % subsystem.every:
                continue
            body = subsystem.encode([values[place] for place in subsystem.columns])
            self.messages.append(message(channel, at, body, int(tick)))
        self.messages.append(message(TICK, at, messages.tick(int(tick), tick / RATE, lateness), int(tick)))

    def end_group(self):
        for bus in sorted(self.group):
            data = messages.frames(self.drained, self.group[bus])
            self.messages.append(message(BUSES[bus], WALL + self.first, data, self.drain))
        self.group, self.order = {}, 0


def encoder(subsystems, buses):
    rows = [
        (channel, body, [(place, 2 + column) for place, column in places], subsystem.every)
        for channel, subsystem in enumerate(subsystems, 1)
        for body, places in [subsystem.template()]
    ]
    return Encoder(RATE, rows, TICK, list(BUSES[:buses]))


def test_messages_and_their_index_are_those_of_python():
    subsystems = messages.subsystems("robot", SIGNALS)
    for seed, buses in ((1, 1), (2, 2), (3, 2)):
        native, oracle, data, places = encoder(subsystems, buses), Oracle(subsystems, buses), b"", {}
        made = records(seed, buses)
        for start in range(0, len(made), 37):  # a drain and its frames can be in two batches
            batch, at = Batch(made[start : start + 37]), 0
            while at < batch.size:
                at = native.encode(batch, at, len(data), len(data) + 300, WALL, FIRST_TICK)
                if native.size > 200:
                    more, index = native.take()
                    data += more
                    for channel, pairs in index.items():
                        places.setdefault(channel, []).extend(PLACE.iter_unpack(pairs))
        native.end_group(len(data))
        more, index = native.take()
        data += more
        for channel, pairs in index.items():
            places.setdefault(channel, []).extend(PLACE.iter_unpack(pairs))
        for kind, payload in made:
            oracle.add(kind, payload)
        oracle.end_group()
        assert data == b"".join(oracle.messages)
        at, expected = 0, {}
        for record in oracle.messages:
            _, _, channel, _, log_time, _ = MESSAGE.unpack_from(record)
            expected.setdefault(channel, []).append((log_time, at))
            at += len(record)
        assert places == expected
        assert native.row_count == 60 and native.frame_count == sum(kind == RECORD_FRAME for kind, _ in made)


def test_frames_of_two_buses_keep_their_order_across_a_flush_within_a_drain():
    def frame(number, bus):
        flags = (False, False, False, False, False, False, False)
        return RECORD_FRAME, Frame(number, number, *flags, bus, b"").pack()

    topics = {TICK: messages.ROW_END, 5: f"{messages.BUS}legs", 7: f"{messages.BUS}arms"}
    about = {"format": "2", "name": "robot", "rate": RATE, "buses": ["legs", "arms"], "signals": []}
    native, drained = Encoder(RATE, [], TICK, [5, 7]), (RECORD_RECEIVED, bytes(8))
    data = b""
    for group in ([drained, frame(0, 0), frame(1, 0)], [frame(2, 1), frame(3, 1)], [frame(4, 0), frame(5, 1)]):
        native.encode(Batch(group), 0, len(data), 1 << 20, 0, 0)
        native.end_group(len(data))  # a flush
        data += native.take()[0]
    frames = Layout("trial.mcap", about, topics).frames(walk_messages(data), 0, 0)
    assert list(frames["id"]) == [0, 1, 2, 3, 4, 5]


def test_a_batch_counts_and_lists_its_rows():
    made = records(4, 2)
    batch = Batch(made)
    frames, bits = [0, 0], [0, 0]
    batch.add_traffic(frames, bits, [1.0, 1.0])
    assert list(batch) == made and batch.rows == 60 and sum(frames) == batch.frames and min(bits) > 47 * min(frames)
    assert batch.first_tick() == 0 and batch.newest()[0] == 59.0
    row = Batch([(RECORD_ROW, row_struct(3).pack(6, 0.5, 1.5, 2.0, float("inf")))])
    assert row.table(200.0, [1, 0, 2], [True, False, True]) == [[0.03, 6, 2, 1.5, float("inf")]]
    assert isinstance(row.table(200.0, [1], [True])[0][2], int) and Batch().newest() is None
