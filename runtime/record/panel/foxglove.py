"""Foxglove's WebSocket protocol, for Foxglove, Lichtblick and PlotJuggler. (github.com/foxglove/ws-protocol, version 1)

A client is sent the messages of the recording: the same topics, schemas, times and values, one of each tick. One that
does not take them fast enough misses the oldest. It reads the live parameters; with the token to operate it also sets
them while no other page has the controls, and stops the run with the service `/tickwork/stop`.
"""

from __future__ import annotations

import base64
import json
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from operator import itemgetter
from struct import Struct
from struct import error as StructError
from typing import TYPE_CHECKING, Annotated, Any

import msgspec
from websockets.exceptions import ConnectionClosed

from runtime.host.live import table
from runtime.record.panel import access
from runtime.record.panel.access import OPERATE
from runtime.record.panel.orders import Set
from runtime.record.panel.pages import Page
from runtime.record.panel.view import encode
from runtime.record.storage import messages
from runtime.record.storage.format import row_struct

if TYPE_CHECKING:
    from runtime.record.panel.orders import Mark
    from runtime.record.panel.view import View

PROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")  # the messages used here are the same in both
MESSAGE_DATA = Struct("<BI")  # opcode, number of the subscription; then the time in ns and the message
TIME = Struct("<Q")
SERVICE_CALL = Struct("<BIII")  # opcode, service, call, bytes of the name of the encoding; then that name and the body
DATA, CALL, RESPONSE = 1, 2, 3  # opcodes
MESSAGES_LIMIT = 2048  # that wait for a client
TICK_LIMIT = 2.0**53
STOP = 1  # number of the service
SERVICE = {
    "id": STOP,
    "name": "/tickwork/stop",
    "type": "tickwork/Stop",
    **{
        side: {"encoding": "json", "schemaName": f"tickwork.{name}", "schemaEncoding": "jsonschema", "schema": schema}
        for side, name, schema in (
            ("request", "StopRequest", '{"type": "object"}'),
            ("response", "StopResponse", '{"type": "object", "properties": {"success": {"type": "boolean"}}}'),
        )
    },
}
TYPES = {"float": "float64", "int": None}
ERROR = 2  # level of a status
Number = Annotated[int, msgspec.Meta(ge=0, lt=1 << 32)]


class Message(msgspec.Struct, tag_field="op", rename="camel"):
    """Message of a client."""


class Subscription(msgspec.Struct, rename="camel"):
    """Number that a client gives to a channel."""

    id: Number
    channel_id: int


class Subscribe(Message, tag="subscribe"):
    """Send the messages of channels."""

    subscriptions: list[Subscription]


class Unsubscribe(Message, tag="unsubscribe"):
    """Send them no longer."""

    subscription_ids: list[int]


class GetParameters(Message, tag="getParameters"):
    """Send the values of parameters, of all for an empty list."""

    parameter_names: list[str]
    id: str | None = None


class Value(msgspec.Struct):
    """New value of a parameter."""

    name: str
    value: bool | float


class SetParameters(Message, tag="setParameters"):
    """Change parameters in one tick."""

    parameters: list[Value]
    id: str | None = None


class Follow(Message, tag="subscribeParameterUpdates"):
    """Send the values of parameters, of all for an empty list, when they change."""

    parameter_names: list[str]


class Unfollow(Message, tag="unsubscribeParameterUpdates"):
    """Send them no longer."""

    parameter_names: list[str]


MESSAGES = msgspec.json.Decoder(Subscribe | Unsubscribe | GetParameters | SetParameters | Follow | Unfollow)


class Feed:
    """The messages of one run, which its clients share. view : View of the run"""

    def __init__(self, view: View) -> None:
        self.view, self.plan = view, view.plan
        parts = messages.subsystems(view.table.name, self.plan["signals"])
        own_tick, _, own_event, _ = messages.OWN
        kinds = [
            *((part.topic, part.descriptor()) for part in parts),
            (messages.ROW_END, messages.simple(own_tick, messages.TICK)),
            (messages.EVENTS, messages.simple(own_event, messages.EVENT)),
        ]
        self.channels = [
            {
                "id": number,
                "topic": topic,
                "encoding": "protobuf",
                "schemaName": name,
                "schema": base64.b64encode(descriptor).decode(),
                "schemaEncoding": "protobuf",
            }
            for number, (topic, (descriptor, name)) in enumerate(kinds, 1)
        ]
        self.unpack = row_struct(len(self.plan["signals"])).unpack
        self.encoders = [*map(self.encoder, parts), self.encode_tick]  # of the channels from 1
        self.event_channel = len(kinds)
        self.rows: list[bytes] = []
        self.encoded: dict[int, list[bytes]] = {}

    def encoder(self, part: messages.Subsystem) -> Callable[[tuple[float, ...]], bytes | None]:
        """Return the function that returns the message of a subsystem in a row, None for a row without it."""
        pick = itemgetter(*(2 + column for column in part.columns), 0)  # a tuple, also of one column
        return lambda row: None if row[0] % part.every else part.encode(pick(row)[:-1])

    def encode_tick(self, row: tuple[float, ...]) -> bytes:
        """Return the last message of a row."""
        return messages.tick(int(row[0]), row[0] / self.plan["rate"], row[1])

    def time(self, tick: float) -> bytes:
        """Return the time of a tick, as the recording has it."""
        shared = self.view.shared
        return TIME.pack(shared.wall + shared.first_tick + round(tick / self.plan["rate"] * 1e9))

    def newest(self, channel: int) -> list[bytes]:
        """Return the messages of a channel in the newest rows, each after its time."""
        if self.rows is not self.view.row.rows:
            self.rows, self.encoded = self.view.row.rows, {}
        if channel not in self.encoded and channel <= len(self.encoders):
            encode, self.encoded[channel] = self.encoders[channel - 1], []
            for row in map(self.unpack, self.rows):
                if 0.0 <= row[0] < TICK_LIMIT and (message := encode(row)) is not None:
                    self.encoded[channel].append(self.time(row[0]) + message)
        return self.encoded.get(channel, [])

    def event(self, event: dict[str, Any]) -> bytes:
        """Return the message of an event, after its time."""
        tick = event.get("tick", -1)
        return self.time(max(0, tick)) + messages.event(event["event"], tick, json.dumps(event))


class Client(Page):
    """One client. Its orders are those of a page; `subscriptions` has its numbers of channels."""

    def __init__(self, *page: Any) -> None:
        super().__init__(*page)
        self.feed: Feed = self.server.feed
        self.subscriptions: dict[int, int] = {}
        self.waiting: deque[tuple[int, bytes]] = deque(maxlen=MESSAGES_LIMIT)
        self.parameters = {
            each.path: each for each in self.server.view.table.parameters if each.path not in self.server.view.withheld
        }
        self.followed: dict[str, Any] = {}  # {name: the value that was sent}
        self.count = 0  # of its orders
        self.asked: dict[int, SetParameters] = {}  # {number of an order that waits: its message}

    def greet(self) -> None:
        view, may = self.server.view, self.role == OPERATE
        self.say(
            "serverInfo",
            name=f"Tickwork: {view.table.name}",
            capabilities=["parameters", "parametersSubscribe", *["services"] * may],
            supportedEncodings=["json"],
            metadata={"diagram": view.table.name, "page": self.name},
            sessionId=access.derived(view.plan["secret"], "run"),
        )
        self.say("advertise", channels=self.feed.channels)
        if may:
            self.say("advertiseServices", services=[SERVICE])

    def say(self, op: str, **message: Any) -> None:
        """Send a message in JSON."""
        self.events.append(encode({"op": op, **message}))

    def complain(self, text: str) -> bool:
        """Send an error. Returns True."""
        self.say("status", level=ERROR, message=text)
        self.server.wake()
        return True

    def renew(self) -> None:
        for channel, number in self.subscriptions.items():
            self.waiting.extend((number, message) for message in self.feed.newest(channel))
        values = self.values(self.followed) if self.followed else []
        if changed := [each for each in values if self.followed[each["name"]] != each["value"]]:
            self.followed.update((each["name"], each["value"]) for each in changed)
            self.say("parameterValues", parameters=changed)

    def tell(self, text: str, event: dict[str, Any]) -> None:
        if self.feed.event_channel in self.subscriptions:
            self.waiting.append((self.subscriptions[self.feed.event_channel], self.feed.event(event)))

    async def send(self) -> None:
        with suppress(ConnectionClosed):
            while True:
                while self.events:
                    await self.connection.send(self.events.popleft())
                while self.waiting and not self.events:
                    number, message = self.waiting.popleft()
                    await self.connection.send(MESSAGE_DATA.pack(DATA, number) + message)
                if not self.events:
                    await self.server.news.wait()

    def values(self, names: Any) -> list[dict[str, Any]]:
        """Return parameters with their targets."""
        targets = table.values(self.server.view.shared, self.server.view.table.parameters)
        return [
            {"name": name, "value": each.plain(targets[each.index][1]), "type": TYPES.get(each.dtype)}
            for name in names
            if (each := self.parameters.get(name)) is not None
        ]

    def take(self, message: str | bytes) -> bool:
        if isinstance(message, bytes):
            return self.call(message)
        if not self.in_budget():
            return self.server.refuse("rate")
        try:
            asked = MESSAGES.decode(message)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            self.complain(f"not a message that this server takes: {error}")
            return self.server.refuse("malformed")
        if isinstance(asked, Subscribe):
            channels = range(1, 1 + len(self.feed.channels))
            self.subscriptions.update(
                (each.channel_id, each.id) for each in asked.subscriptions if each.channel_id in channels
            )
        elif isinstance(asked, Unsubscribe):
            gone = set(asked.subscription_ids)
            self.subscriptions = {key: number for key, number in self.subscriptions.items() if number not in gone}
        elif isinstance(asked, GetParameters):
            named = {"id": asked.id} if asked.id is not None else {}
            self.say("parameterValues", parameters=self.values(asked.parameter_names or self.parameters), **named)
        elif isinstance(asked, Follow):
            values = self.values(asked.parameter_names or self.parameters)
            self.followed.update((each["name"], each["value"]) for each in values)
        elif isinstance(asked, Unfollow):
            for name in asked.parameter_names or list(self.followed):
                self.followed.pop(name, None)
        else:
            return self.change(asked)
        self.server.wake()
        return True

    def change(self, asked: SetParameters) -> bool:
        """Ask the run for values. The first client or page that asks has the controls."""
        server = self.server
        if self.role != OPERATE:
            self.complain("this address only shows the run: the token to operate is needed to change parameters")
            return server.refuse("role")
        if unknown := [each.name for each in asked.parameters if each.name not in self.parameters]:
            return self.complain(f"no live parameter {', '.join(unknown)}")
        if (other := server.operator) is None:
            server.hand_over(self, "taken")
        elif other is not self:
            return self.complain(f"{other.name} has the controls: give them back there first")
        changes = [(self.parameters[each.name].index, float(each.value)) for each in asked.parameters]
        self.count += 1
        self.asked[self.count] = asked
        self.queue(Set(self.count, changes))
        return True

    def answer(self, order: Set | Mark, answer: dict[str, Any]) -> None:
        asked = self.asked.pop(order.id)
        if not answer["taken"]:
            self.complain(answer["text"])
        if asked.id is not None:
            self.say("parameterValues", parameters=self.values(each.name for each in asked.parameters), id=asked.id)
        self.server.wake()

    def call(self, message: bytes) -> bool:
        """Carry out the call of a service."""
        server = self.server
        try:
            opcode, service, number, size = SERVICE_CALL.unpack_from(message)
        except StructError:
            return server.refuse("malformed")
        if (opcode, service, self.role) != (CALL, STOP, OPERATE):
            return server.refuse("malformed" if self.role == OPERATE else "role")
        server.mailbox.stop(self.number)
        encoding = message[SERVICE_CALL.size :][:size]
        head = SERVICE_CALL.pack(RESPONSE, service, number, len(encoding))
        self.events.append(head + encoding + b'{"success": true}')
        server.wake()
        return True
