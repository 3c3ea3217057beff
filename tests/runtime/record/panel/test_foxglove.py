"""Foxglove's protocol on the port of the panel: messages of the recording, parameters, and a stop with the token."""

import base64
import json
import random
import shutil
import struct
import subprocess
import time

import pytest
from mcap.reader import make_reader
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from tests.runtime.record.panel.panels import running
from tests.runtime.runs import assert_safely_stopped

pytestmark = pytest.mark.paced
PROTOCOL = "foxglove.websocket.v1"
GAIN = "left/law.gain"
STOP = struct.pack("<BIII", 2, 1, 77, 4) + b"json{}"


class Client:
    """A client that keeps what arrives."""

    def __init__(self, address, protocol=PROTOCOL, **headers):
        self.socket = connect(address, subprotocols=[protocol], compression=None, **headers).__enter__()
        self.texts, self.messages, self.replies, self.asked = [], [], [], 0
        self.until(lambda: self.said("advertise"))

    def take(self):
        message = self.socket.recv(timeout=10.0)
        if isinstance(message, str):
            self.texts.append(json.loads(message))
        elif message[0] == 1:
            self.messages.append((*struct.unpack_from("<IQ", message, 1), message[13:]))
        else:
            self.replies.append(message)

    def until(self, condition, timeout=20.0):
        end = time.monotonic() + timeout
        while not (value := condition()):
            assert time.monotonic() < end, self.texts
            self.take()
        return value

    def until_closed(self):
        with pytest.raises(ConnectionClosed):
            while True:
                self.take()

    def said(self, op):
        return [text for text in self.texts if text["op"] == op]

    def send(self, op, **message):
        self.socket.send(json.dumps({"op": op, **message}))

    def subscribe(self):
        """Subscribe to all channels, with numbers that differ from those of the channels."""
        [advertised] = self.said("advertise")
        self.channels = {100 + channel["id"]: channel for channel in advertised["channels"]}
        self.send(
            "subscribe", subscriptions=[{"id": key, "channelId": each["id"]} for key, each in self.channels.items()]
        )

    def set(self, **message):
        """Set parameters. Returns the answer and the error, if there is one."""
        self.texts.clear()
        self.asked += 1

        def answers():
            return [answer for answer in self.said("parameterValues") if answer.get("id") == str(self.asked)]

        self.send("setParameters", id=str(self.asked), **message)
        self.until(lambda: answers() or self.said("status"))
        return [answer["parameters"] for answer in answers()], [status["message"] for status in self.said("status")]


def links(run):
    """Addresses for clients of a run on this computer: without a token, and with that to operate."""
    page = run.page()
    page.socket.close()
    return page.hello["link"].partition("?")[0], page.hello["link"]


def test_messages_are_those_of_the_recording(tmp_path):
    with running(tmp_path) as run:
        client = Client(links(run)[1], "foxglove.sdk.v1")
        client.subscribe()
        client.until(lambda: len(client.messages) > 600)
        client.socket.send(STOP)
        client.until(lambda: client.replies)
        client.until_closed()
        code, said = run.end()
    assert code == 0 and "stopped by page 2 of the panel" in said
    assert client.replies == [struct.pack("<BIII", 3, 1, 77, 4) + b'json{"success": true}']
    with open(run.files.one(".mcap"), "rb") as file:
        recorded, schemas = {}, {}
        for schema, channel, message in make_reader(file).iter_messages():
            recorded.setdefault(channel.topic, {}).setdefault(message.log_time, []).append(message.data)
            schemas[channel.topic] = schema
    topics = {channel["topic"] for channel in client.channels.values()}
    assert (
        topics == {"/left", "/right", "/tickwork/tick", "/tickwork/events"} == recorded.keys() - {"/tickwork/can/legs"}
    )
    for number, channel in client.channels.items():
        schema, rows = schemas[channel["topic"]], recorded[channel["topic"]]
        assert (channel["encoding"], channel["schemaEncoding"], channel["schemaName"]) == ("protobuf",) * 2 + (
            schema.name,
        )
        assert base64.b64decode(channel["schema"]) == schema.data
        live = [(at, data) for key, at, data in client.messages if key == number]
        assert all(data in rows[at] for at, data in live)
        if channel["topic"] != "/tickwork/events":  # each tick from the first to the last
            times = [at for at, _ in live]
            assert len(live) > 100 and times == [at for at in rows if times[0] <= at <= max(rows)]


@pytest.mark.hazard("H9g")
def test_client_without_the_token_only_watches_and_one_with_it_changes_what_no_other_page_controls(tmp_path):
    with running(tmp_path) as run:
        plain, link = links(run)
        watches = Client(plain)
        assert watches.said("serverInfo")[0]["capabilities"] == ["parameters", "parametersSubscribe"]
        assert watches.said("advertiseServices") == []
        watches.socket.send(STOP)
        assert watches.set(parameters=[{"name": GAIN, "value": 2.0}])[1][0].startswith(
            "this address only shows the run"
        )
        watches.send("subscribeParameterUpdates", parameterNames=[])
        page = run.page()
        assert Client(link).set(parameters=[{"name": GAIN, "value": 2.0}])[1] == [
            "page 3 has the controls: give them back there first"
        ]
        page.socket.close()
        operates = Client(link)
        applied = [{"name": GAIN, "value": 2.0, "type": "float64"}]
        assert operates.set(parameters=[{"name": GAIN, "value": 2}]) == ([applied], [])
        watches.until(lambda: any(each["parameters"][0]["value"] == 2.0 for each in watches.said("parameterValues")))
        for value, words in ((3.5, "out of bounds"), ("x", "not a message"), (None, "not a message")):
            assert words in operates.set(parameters=[{"name": GAIN, "value": value}])[1][0]
        assert operates.set(parameters=[{"name": "gian", "value": 1.0}])[1] == ["no live parameter gian"]
        assert operates.set(parameters=[{"name": "left/knee.disabled", "value": False}])[1][0].startswith("no live")
        operates.texts.clear()
        operates.send("getParameters", parameterNames=[])
        [values] = operates.until(lambda: operates.said("parameterValues"))
        assert {each["name"]: each["value"] for each in values["parameters"]} == {GAIN: 2.0, "right/law.gain": 1.0}
        for headers in ({"origin": "https://app.foxglove.dev"}, {"origin": plain.replace("ws", "http", 1).rstrip("/")}):
            with pytest.raises(InvalidStatus):
                Client(plain, **headers)
            Client(link, **headers)
        with pytest.raises(InvalidStatus):
            Client(link[:-1])
        operates.socket.send(STOP)
        assert run.end()[0] == 0
    assert_safely_stopped(run.files, (1, 2))
    told = [(each["event"], each["by"], each.get("value")) for each in run.files.sidecar["events"] if "by" in each]
    assert told == [("set", "page 5", 2.0), ("stop", "page 5", None)]


@pytest.mark.soak
def test_client_on_a_network_needs_a_token(tmp_path):
    with running(tmp_path, host="0.0.0.0") as run:
        view, operate = (run.addresses[role].replace("http", "ws", 1).replace("#", "?") for role in ("view", "operate"))
        for wrong in (view.partition("?")[0], view[:-1]):
            with pytest.raises(InvalidStatus):
                Client(wrong)
        assert Client(view).said("advertiseServices") == []
        Client(operate).socket.send(STOP)
        assert run.end()[0] == 0


@pytest.mark.hazard("H9g")
def test_stalled_and_hostile_clients_disturb_neither_the_run_nor_other_clients(tmp_path):
    chance = random.Random(1)
    with running(tmp_path) as run:
        plain, link = links(run)
        for _ in range(3):
            Client(plain).subscribe()  # and takes nothing
        healthy = Client(plain)
        healthy.subscribe()
        pieces = [
            '{"op": "subscribe"',
            '"subscriptions": [',
            '{"id": -1, "channelId": 1}',
            "]}",
            "\0",
            "9" * 400,
            '"op"',
            STOP,
        ]
        hostile = Client(link)
        with pytest.raises(ConnectionClosed):
            for _ in range(2000):
                part = chance.choice([*pieces, chance.randbytes(chance.randrange(60))])
                hostile.socket.send(part if part != STOP else STOP[:-8])
                time.sleep(0.001)
        count = len(healthy.messages)
        healthy.until(lambda: len(healthy.messages) > count + 600)
        run.page().send(do="stop")
        assert run.end()[0] == 0


# With the client that Foxglove publishes: values of the message "/left", the parameter, and the stop.
SCRIPT = """
const { FoxgloveClient } = require("@foxglove/ws-protocol");
const client = new FoxgloveClient({ ws: new (require("ws"))(process.argv[2], [FoxgloveClient.SUPPORTED_SUBPROTOCOL]) });
const told = { topics: [], count: 0, bytes: 0, changed: null, stopped: null };
client.on("error", (error) => { throw error; });
client.on("advertise", (channels) => {
  told.topics = channels.map(({ topic }) => topic);
  client.subscribe(channels.find(({ topic }) => topic === "/left").id);
});
client.on("message", ({ data }) => {
  told.bytes = data.byteLength;
  if ((told.count += 1) === 200) client.setParameters([{ name: "left/law.gain", value: 2.5 }], "changed");
});
client.on("parameterValues", ({ parameters, id }) => {
  if (id !== "changed") return;
  told.changed = parameters[0].value;
  const data = new TextEncoder().encode("{}");
  client.sendServiceCallRequest({ serviceId: told.service, callId: 3, encoding: "json", data });
});
client.on("advertiseServices", ([service]) => { told.service = service.id; });
client.on("serviceCallResponse", ({ data }) => { told.stopped = JSON.parse(new TextDecoder().decode(data)); });
client.on("close", () => console.log(JSON.stringify(told)));
"""


@pytest.mark.soak
def test_the_client_that_foxglove_publishes_reads_changes_and_stops(tmp_path):
    if shutil.which("npm") is None:
        pytest.skip("no npm here")
    subprocess.run(["npm", "install", "--silent", "@foxglove/ws-protocol", "ws"], cwd=tmp_path, check=True, timeout=120)
    (tmp_path / "client.js").write_text(SCRIPT)
    with running(tmp_path) as run:
        made = subprocess.run(
            ["node", "client.js", links(run)[1]], cwd=tmp_path, capture_output=True, text=True, timeout=60
        )
        assert run.end()[0] == 0
    told = json.loads(made.stdout)
    assert told["topics"] == ["/left", "/right", "/tickwork/tick", "/tickwork/events"]
    assert told["count"] >= 200 and told["changed"] == 2.5 and told["stopped"] == {"success": True}
