"""What is told reaches whoever listens, whatever their terminal or file can hold."""

import io

import pytest

from runtime.telling.terminal import write

LINE = "late by 61 µs at −4.5 N·m, 30° … ━╌ 漢"


@pytest.mark.parametrize("encoding, expected", [
    ("utf-8", LINE), ("ascii", "late by 61 us at -4.5 N*m, 30 deg ... #. ?"), ("latin-1", "late by 61 µs at -4.5 N·m, 30° ... #. ?")])
def test_units_stay_readable_in_an_encoding_without_them(encoding, expected):
    file = io.TextIOWrapper(io.BytesIO(), encoding)
    write([LINE], file)
    assert file.buffer.getvalue().decode(encoding) == expected + "\n"
