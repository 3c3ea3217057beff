"""liblsl, the library of the Lab Streaming Layer (https://labstreaminglayer.org), called by ctypes and without NumPy.

Its clock is CLOCK_MONOTONIC of the computer. Its functions are those of the header lsl_c.h.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from ctypes import CDLL, POINTER, byref, c_char_p, c_double, c_int32, c_ulong, c_void_p
from ctypes.util import find_library
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from runtime.host.optional_dependencies import MissingExtra

DOUBLE, STRING = 2, 3  # formats of channels
BUFFER = 60  # s of samples that are kept for a receiver which reads too slowly
RESOLVE_TIME = 2.0  # s, in which the outlets of the network answer
OPEN_TIMEOUT = 5.0  # s
CORRECTION_TIMEOUT = 2.0  # s
CHUNK = 1024  # samples
LOST = -2  # error code
BUNDLED = {"pylsl": "lib", "mne_lsl": "lsl/lib"}  # package: its folder with the library, if its wheel has one
CONFIGURATIONS = ("lsl_api.cfg", "~/lsl_api/lsl_api.cfg", "/etc/lsl_api/lsl_api.cfg")  # in which liblsl looks
QUIET = b"[log]\nlevel = -3\n"  # no messages on the terminal

_TEXTS = (c_char_p, c_char_p)
_SIGNATURES = {
    "lsl_append_child": (c_void_p, c_void_p, c_char_p),
    "lsl_append_child_value": (c_void_p, c_void_p, *_TEXTS),
    "lsl_child": (c_void_p, c_void_p, c_char_p),
    "lsl_child_value_n": (c_char_p, c_void_p, c_char_p),
    "lsl_create_inlet": (c_void_p, c_void_p, c_int32, c_int32, c_int32),
    "lsl_create_outlet": (c_void_p, c_void_p, c_int32, c_int32),
    "lsl_create_streaminfo": (c_void_p, *_TEXTS, c_int32, c_double, c_int32, c_char_p),
    "lsl_destroy_inlet": (None, c_void_p),
    "lsl_destroy_outlet": (None, c_void_p),
    "lsl_destroy_streaminfo": (None, c_void_p),
    "lsl_get_channel_format": (c_int32, c_void_p),
    "lsl_get_channel_count": (c_int32, c_void_p),
    "lsl_get_desc": (c_void_p, c_void_p),
    "lsl_get_fullinfo": (c_void_p, c_void_p, c_double, POINTER(c_int32)),
    "lsl_get_hostname": (c_char_p, c_void_p),
    "lsl_get_name": (c_char_p, c_void_p),
    "lsl_get_nominal_srate": (c_double, c_void_p),
    "lsl_get_source_id": (c_char_p, c_void_p),
    "lsl_have_consumers": (c_int32, c_void_p),
    "lsl_local_clock": (c_double,),
    "lsl_next_sibling_n": (c_void_p, c_void_p, c_char_p),
    "lsl_open_stream": (None, c_void_p, c_double, POINTER(c_int32)),
    "lsl_pull_chunk_d": (
        c_ulong, c_void_p, POINTER(c_double), POINTER(c_double), c_ulong, c_ulong, c_double, POINTER(c_int32)
    ),
    "lsl_pull_sample_d": (c_double, c_void_p, POINTER(c_double), c_int32, c_double, POINTER(c_int32)),
    "lsl_push_chunk_dtnp": (c_int32, c_void_p, c_void_p, c_ulong, c_void_p, c_int32),
    "lsl_push_sample_strtp": (c_int32, c_void_p, POINTER(c_char_p), c_double, c_int32),
    "lsl_resolve_bypred": (c_int32, POINTER(c_void_p), c_int32, c_char_p, c_int32, c_double),
    "lsl_set_config_content": (None, c_char_p),
    "lsl_time_correction": (c_double, c_void_p, c_double, POINTER(c_int32)),
    "lsl_was_clock_reset": (c_int32, c_void_p),
}  # fmt: skip


def candidates() -> Iterator[str]:
    """Yield where the library can be, in the order in which it is tried."""
    if named := os.environ.get("PYLSL_LIB"):
        yield named
    for package, folder in BUNDLED.items():
        spec = find_spec(package)
        for place in (spec.submodule_search_locations or ()) if spec is not None else ():
            yield from map(str, sorted(Path(place, folder).glob("liblsl.so*")))
    if installed := find_library("lsl"):
        yield installed


@cache
def load(purpose: str = "the Lab Streaming Layer") -> CDLL:
    """Load the library. Raises MissingExtra. purpose : what needs it, as the beginning of a sentence"""
    reason = "none is installed"
    for path in candidates():
        try:
            library = CDLL(path)
            for name, (result, *arguments) in _SIGNATURES.items():
                function = getattr(library, name)
                function.restype, function.argtypes = result, arguments
        except (OSError, AttributeError) as error:
            reason = str(error)
            continue
        if not os.environ.get("LSLAPICFG") and not any(Path(file).expanduser().exists() for file in CONFIGURATIONS):
            library.lsl_set_config_content(QUIET)
        return library
    raise MissingExtra(
        f"{purpose} needs liblsl ({reason}): pip install 'tickwork[lsl]'; on a Raspberry Pi also "
        "pip install --no-deps mne-lsl, whose wheel contains it"
    )


class Outlet:
    """Outlet of a stream, which sends to every receiver in the network.

    name, kind, source : name, content type and source_id of the stream. A receiver continues with a new outlet of the
        same source
    channels : (label, unit) of each channel
    rate : Hz, 0 for irregular samples
    texts : whether the channels are texts instead of doubles
    about : further (name, text) of the description

    Raises MissingExtra or OSError.
    """

    def __init__(
        self,
        name: str,
        kind: str,
        source: str,
        channels: Sequence[tuple[str, str]],
        rate: float = 0.0,
        texts: bool = False,
        about: Iterable[tuple[str, str]] = (),
    ) -> None:
        self.library = library = load("an outlet")
        width, form = len(channels), STRING if texts else DOUBLE
        info = library.lsl_create_streaminfo(name.encode(), kind.encode(), width, rate, form, source.encode())
        try:
            description = library.lsl_get_desc(info)
            listed = library.lsl_append_child(description, b"channels")
            for label, unit in channels:
                channel = library.lsl_append_child(listed, b"channel")
                for key, text in (("label", label), ("unit", unit), ("type", kind)):
                    library.lsl_append_child_value(channel, key.encode(), text.encode())
            acquisition = library.lsl_append_child(description, b"acquisition")
            for key, text in about:
                library.lsl_append_child_value(acquisition, key.encode(), text.encode())
            self.handle = library.lsl_create_outlet(info, 0, BUFFER)
        finally:
            library.lsl_destroy_streaminfo(info)
        if not self.handle:
            raise OSError(0, f"liblsl cannot open an outlet {name!r}: check that this computer has a network interface")

    def push(self, values: bytes, stamps: bytes) -> None:
        """Send samples. values : doubles of each sample; stamps : double of each sample, s of the clock of LSL"""
        self.library.lsl_push_chunk_dtnp(self.handle, values, len(values) // 8, stamps, 1)

    def push_text(self, text: str, stamp: float) -> None:
        """Send a sample of one text. stamp : s of the clock of LSL"""
        self.library.lsl_push_sample_strtp(self.handle, byref(c_char_p(text.encode())), stamp, 1)

    @property
    def has_receivers(self) -> bool:
        """Whether a receiver is connected."""
        return bool(self.library.lsl_have_consumers(self.handle))

    def close(self) -> None:
        """Close the outlet."""
        self.library.lsl_destroy_outlet(self.handle)


@dataclass(frozen=True)
class StreamInfo:
    """Stream that was found in the network. handle : its lsl_streaminfo"""

    handle: int
    host: str
    source: str


def found(name: str, source: str = "", enough: int = 64) -> list[StreamInfo]:
    """Return the streams of a name and a source_id, of which one may be empty. Raises MissingExtra.

    enough : number of streams of the source_id, or of the name without one, after which the search ends
    """
    library, handles = load("an inlet"), (c_void_p * 64)()
    predicate = f"source_id={quoted(source)}" if source else f"name={quoted(name)}"
    count = library.lsl_resolve_bypred(handles, len(handles), predicate.encode(), enough, RESOLVE_TIME)
    infos = [
        StreamInfo(handle, decoded(library.lsl_get_hostname(handle)), decoded(library.lsl_get_source_id(handle)))
        for handle in handles[: max(0, count)]  # it is a negative error code
    ]
    return [info for info in infos if not name or decoded(library.lsl_get_name(info.handle)) == name]


class Inlet:
    """Receiver of a stream of numbers. It continues with a new outlet of the same source_id, channels and rate.

    about : {"name", "host", "source", "rate", "channels": [(label, unit)]}
    rate : Hz, 0 for irregular samples
    restarts : number of new outlets. liblsl counts those after the first call of `correction`

    Raises OSError.
    """

    def __init__(self, info: StreamInfo) -> None:
        self.library = library = load("an inlet")
        self.handle = library.lsl_create_inlet(info.handle, BUFFER, 0, 1)
        self.error = c_int32()
        library.lsl_open_stream(self.handle, OPEN_TIMEOUT, byref(self.error))
        whole = library.lsl_get_fullinfo(self.handle, OPEN_TIMEOUT, byref(self.error)) if not self.error else None
        if not whole:
            raise OSError(0, f"the stream of {info.host} does not respond: check the firewall of that computer")
        if library.lsl_get_channel_format(whole) == STRING:
            raise OSError(0, "the stream contains texts, not numbers")
        self.width, self.rate = library.lsl_get_channel_count(whole), library.lsl_get_nominal_srate(whole)
        channel = library.lsl_child(library.lsl_child(library.lsl_get_desc(whole), b"channels"), b"channel")
        channels: list[list[str]] = []
        for _ in range(self.width):
            channels.append([decoded(library.lsl_child_value_n(channel, key)) for key in (b"label", b"unit")])
            channel = library.lsl_next_sibling_n(channel, b"channel")
        name = decoded(library.lsl_get_name(whole))
        self.about: dict[str, Any] = {
            "name": name, "host": info.host, "source": info.source, "rate": self.rate, "channels": channels
        }  # fmt: skip
        self.values, self.stamps = (c_double * (CHUNK * self.width))(), (c_double * CHUNK)()
        self.restarts = 0
        self.same: bool | None = True  # whether the present outlet has the channels of the first; None: not yet known

    def pull(self, timeout: float) -> tuple[list[list[float]], list[float]]:
        """Return (samples, time stamps by the sender's clock) that have arrived; wait `timeout` s for the first.

        Raises OSError if the stream is lost permanently.
        """
        stamp = self.library.lsl_pull_sample_d(self.handle, self.values, self.width, timeout, byref(self.error))
        if self.error.value == LOST:
            raise OSError(0, "the stream is lost, and has no source_id by which it could be found again")
        if not stamp:
            return [], []
        samples, stamps = [self.values[: self.width]], [stamp]
        count = self.library.lsl_pull_chunk_d(
            self.handle, self.values, self.stamps, len(self.values), CHUNK, 0.0, byref(self.error)
        )
        samples += [self.values[at : at + self.width] for at in range(0, count, self.width)]
        if load("an inlet").lsl_was_clock_reset(self.handle):
            self.restarts, self.same = self.restarts + 1, None
        if self.same is None:
            self.same = self.has_same_channels()
        return (samples, stamps + self.stamps[: count // self.width]) if self.same else ([], [])

    def has_same_channels(self) -> bool | None:
        """Return whether the present outlet has the channels and the rate of the first; None if it does not respond.

        liblsl keeps the description of the first one.
        """
        for info in found(self.about["name"], self.about["source"], enough=1):
            with suppress(OSError):
                present = Inlet(info)
                present.close()
                return all(present.about[key] == self.about[key] for key in ("channels", "rate"))
        return None

    def close(self) -> None:
        """Close the inlet."""
        load("an inlet").lsl_destroy_inlet(self.handle)

    def clock(self) -> float:
        """Return the time in s of the LSL clock of this computer."""
        return self.library.lsl_local_clock()

    def correction(self) -> float | None:
        """Return what the sender's time stamps lack to the clock of this computer in s; None if it is unknown."""
        error = c_int32()
        value = self.library.lsl_time_correction(self.handle, CORRECTION_TIMEOUT, byref(error))
        return None if error.value else value


def quoted(text: str) -> str:
    """Return a text as a literal of XPath, which has no escapes."""
    parts = [f"'{part}'" for part in text.split("'")]
    joined = """, "'", """.join(parts)
    return f"concat({joined})" if len(parts) > 1 else joined


def decoded(data: bytes) -> str:
    """Return a text of a stream. Not every sender encodes it as UTF-8."""
    return data.decode(errors="replace")
