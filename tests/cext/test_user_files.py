"""Files of users that are read as a whole: what is too large, or never ends, is refused before it is read."""

import errno
import os

import pytest

from cext.user_files import SMALL_FILE_LIMIT, read_small


def test_a_file_is_read_up_to_the_limit(tmp_path):
    path = tmp_path / "lab.toml"
    for content in (b"", b"a = 1\n", bytes(100)):
        path.write_bytes(content)
        assert read_small(path) == read_small(str(path), limit=100) == content
    with pytest.raises(OSError, match="is larger than 0 MB"):
        read_small(path, limit=99)


def test_a_file_without_an_end_is_refused_with_its_name(tmp_path):
    sparse, pipe = tmp_path / "zeros.toml", tmp_path / "pipe.toml"
    with open(sparse, "wb") as file:
        file.truncate(1 << 40)
    os.mkfifo(pipe)
    for path, number in ((sparse, errno.EFBIG), ("/dev/zero", errno.EFBIG), (pipe, errno.EINVAL)):
        with pytest.raises(OSError) as caught:
            read_small(path)
        assert (caught.value.errno, caught.value.filename) == (number, str(path))
    assert read_small("/dev/null") == b"" and SMALL_FILE_LIMIT == 16 << 20
