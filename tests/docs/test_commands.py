"""Command lines of every page: the parser of their command accepts them."""

import pytest

from tests.checkout import ROOT
from tests.docs.command_lines import LINE, refusal, words
from tests.docs.pages import NAMES


@pytest.mark.parametrize("page", NAMES)
def test_every_command_line_of_the_page_is_accepted(page):
    for line in LINE.findall((ROOT / page).read_text()):
        assert not refusal(words(line)), line


def test_a_wrong_option_is_refused():
    assert "--rat" in refusal(["stream", "imu", "--rat", "100"])
