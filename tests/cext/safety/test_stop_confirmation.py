"""Confirmation of a safe stop by the values of single replies, in virtual time. With whole drives of every family:
tests/cext/schedule/test_stop_values.py.
"""

import math
import struct

import pytest

from cext.safety.stop_confirmation import StopConfirmation
from cext.safety.thresholds import STOP_LISTEN_LIMIT, STOP_REPORTS, STOP_REST
from graph import ReplyField, StopReply

ROUND = 5_000_000  # ns
ID, OTHER = 0x101, 0x102
FRAMES = ((ID, 0x7FF, False, b""), (OTHER, 0x7FF, False, b""))
TORQUE = ReplyField(FRAMES, 8, 16, -32.768, 32.767, signed=True)
STATE = ReplyField(FRAMES, 24, 8, 0.0, 255.0)
BEGIN = 200  # rounds since the begin of the clock
ECHO = (0, 0xA1)  # byte of a report, and its value after a disable


def confirming(**options):
    return StopConfirmation(StopReply(FRAMES, **{"torque": TORQUE, "rest": 0.5} | options))


def reply(torque, state=0):
    return struct.pack(">BhB", state, round(torque * 1000), state)


def ask(confirmation, rounds, answers=(reply(0.0), reply(0.0)), begin=0, source=ID):
    """Rounds of a stop, each answered after 1 ms. Returns the time of the next."""
    for number in range(begin, begin + rounds):
        confirmation.judge(number * ROUND, ROUND)
        if confirmation.may_send():
            confirmation.sent(number * ROUND, len(answers))
            for data in answers:
                assert confirmation.note_frame(source, data, number * ROUND + 1_000_000)
    return (begin + rounds) * ROUND


def in_the_silence(**options):
    """A drive that has answered two rounds at rest, and is asked nothing now. Returns it and the time."""
    confirmation = confirming(**options)
    confirmation.begin(BEGIN * ROUND)
    now = ask(confirmation, 2, begin=BEGIN)
    assert not confirmation.judge(now, ROUND) and not confirmation.may_send()
    return confirmation, now


def test_a_question_that_is_answered_at_rest_and_a_silence_confirm():
    confirmation, now = in_the_silence()
    assert confirmation.judge(now + ROUND, ROUND) and confirmation.may_send()


def test_the_silence_may_be_a_quarter_of_a_round_short_as_rounds_begin_late_at_times():
    confirmation, now = in_the_silence()
    assert not confirmation.judge(now + ROUND - ROUND // 4 - 1, ROUND)
    assert confirmation.judge(now + ROUND - ROUND // 4, ROUND)


def test_a_device_without_torque_confirms_by_its_replies():
    confirmation = StopConfirmation(StopReply(FRAMES))
    ask(confirmation, 4)
    assert confirmation.confirmed


@pytest.mark.hazard("H9d")
@pytest.mark.parametrize(
    "data",
    [reply(0.6), reply(-0.6), reply(5.0), reply(0.0)[:2], b""],
    ids=["torque", "negative torque", "much", "half a torque", "empty"],
)
def test_a_frame_in_the_silence_that_does_not_report_rest_lets_the_stop_go_on(data):
    confirmation, now = in_the_silence()
    assert confirmation.note_frame(ID, data, now + 2_000_000)
    assert confirmation.may_send(), "at once"
    assert not confirmation.judge(now + ROUND, ROUND)
    ask(confirmation, 30, begin=now // ROUND + 1)
    assert confirmation.confirmed, "once it is at rest again"


@pytest.mark.hazard("H9d")
@pytest.mark.parametrize("data", [reply(0.6), reply(0.0)[:2]], ids=["torque", "half a torque"])
def test_one_of_two_replies_that_does_not_report_rest_confirms_nothing(data):
    confirmation = confirming()
    ask(confirmation, 40, (reply(0.0), data))
    assert not confirmation.confirmed


def test_a_round_with_all_of_its_replies_and_one_with_torque_among_them_confirms_nothing():
    confirmation = confirming()
    for number in range(20):
        confirmation.judge(number * ROUND, ROUND)
        if confirmation.may_send():
            confirmation.sent(number * ROUND, 2)
            for torque in (0.0, 3.0, 0.0):
                confirmation.note_frame(ID, reply(torque), number * ROUND + 1_000_000)
    assert not confirmation.confirmed and confirmation.may_send()


@pytest.mark.parametrize("torque, rests", [(0.5, True), (-0.5, True), (0.501, False), (-0.501, False)])
def test_rest_is_a_torque_up_to_its_limit_in_either_direction(torque, rests):
    confirmation = confirming()
    ask(confirmation, 10, (reply(torque), reply(torque)))
    assert confirmation.confirmed == rests and confirmation.newest == pytest.approx(torque, abs=1e-3)


@pytest.mark.hazard("H9d")
@pytest.mark.parametrize(
    "data, rests",
    [(reply(0.0), True), (reply(0.0, 1), False), (reply(0.0, 255), False), (reply(0.0)[:3], False)],
    ids=["disabled", "enabled", "any bit", "no state"],
)
def test_a_drive_that_reports_its_state_is_at_rest_only_if_that_is_disabled(data, rests):
    confirmation = confirming(enabled=STATE)
    ask(confirmation, 10, (data, data))
    assert confirmation.confirmed == rests


@pytest.mark.parametrize("status, rests", [(0, True), (1, False), (7, False), (8, True), (13, True), (15, True)])
def test_a_signed_status_is_that_of_an_enabled_drive_only_above_zero(status, rests):
    field = ReplyField(STATE.frames, first=STATE.first, bits=4, low=-8.0, high=7.0, signed=True)
    confirmation = confirming(enabled=field)
    ask(confirmation, 10, (reply(0.0, status << 4), reply(0.0, status << 4)))
    assert confirmation.confirmed == rests


def test_bits_of_the_identifier_that_report_an_enabled_drive_confirm_nothing():
    frames = ((0x100, 0x700, False, b""),)
    for source, rests in ((0x101, True), (0x111, False)):
        confirmation = StopConfirmation(StopReply(frames, torque=TORQUE, rest=0.5, disabled=(0x10, 0x00)))
        ask(confirmation, 10, source=source)
        assert confirmation.confirmed == rests, hex(source)


@pytest.mark.parametrize("source, data", [(ID, reply(5.0)[:3]), (ID, reply(5.0) + b"x"), (0x103, reply(5.0))])
def test_a_frame_with_another_length_or_id_is_of_another_device(source, data):
    confirmation, now = in_the_silence(length=4)
    assert not confirmation.note_frame(source, data, now + 1_000_000)
    assert not confirmation.may_send() and confirmation.judge(now + ROUND, ROUND)


def test_replies_of_two_devices_to_one_round_confirm_nothing():
    confirmation = confirming()
    for number in range(20):
        confirmation.judge(number * ROUND, ROUND)
        if confirmation.may_send():
            confirmation.sent(number * ROUND, 2)
            for source in (ID, OTHER):
                confirmation.note_frame(source, reply(0.0), number * ROUND + 1_000_000)
    assert not confirmation.confirmed


def test_a_round_that_was_sent_while_earlier_replies_may_be_under_way_confirms_nothing():
    confirmation = confirming()
    confirmation.begin(BEGIN * ROUND, 3 * ROUND)
    for number in range(4):
        now = ask(confirmation, 1, begin=BEGIN + number)
        assert confirmation.judge(now, ROUND) is False and confirmation.may_send() == (number < 3), number


def test_a_confirmation_is_withdrawn_by_torque_and_given_again_by_a_question_and_a_silence():
    confirmation, now = in_the_silence()
    assert confirmation.judge(now + ROUND, ROUND)
    confirmation.note_frame(ID, reply(2.0), now + ROUND + 1)
    assert not confirmation.confirmed and confirmation.may_send()
    assert not confirmation.judge(now + 2 * ROUND, ROUND)
    ask(confirmation, 40, begin=now // ROUND + 2)
    assert confirmation.confirmed


def test_a_second_stop_needs_a_confirmation_of_its_own_in_as_few_rounds():
    confirmation, now = in_the_silence()
    assert confirmation.judge(now + ROUND, ROUND)
    again = now // ROUND + 8  # a gap that would be one of bursts
    confirmation.begin(again * ROUND)
    assert not confirmation.confirmed and confirmation.may_send() and confirmation.received == 0
    assert math.isnan(confirmation.newest)
    now = ask(confirmation, 3, begin=again)
    assert not confirmation.confirmed and confirmation.judge(now, ROUND)


def test_a_stop_that_begins_in_the_silence_of_another_sends_at_once():
    confirmation, now = in_the_silence()
    confirmation.begin(now)
    assert confirmation.may_send() and not confirmation.judge(now + ROUND, ROUND)


@pytest.mark.parametrize("round, confirms", [(ROUND, False), (STOP_LISTEN_LIMIT, True)])
def test_replies_to_one_round_alone_confirm_only_if_it_is_so_long_that_bursts_end_in_it(round, confirms):
    confirmation = confirming()
    for number in range(2):
        confirmation.judge(number * round, round)
        confirmation.sent(number * round, 2)
    for _ in range(2):
        confirmation.note_frame(ID, reply(0.0), round + 1_000_000)
    assert not confirmation.judge(2 * round, round)
    assert confirmation.judge(3 * round, round) == confirms


def test_the_first_round_confirms_nothing_however_long_it_is():
    confirmation = confirming()
    confirmation.sent(0, 2)
    for _ in range(2):
        confirmation.note_frame(ID, reply(0.0), 1_000_000)
    assert not confirmation.judge(STOP_LISTEN_LIMIT, STOP_LISTEN_LIMIT) and confirmation.may_send()


def test_a_silence_begins_again_one_and_a_half_rounds_after_a_late_reply():
    confirmation, now = in_the_silence()
    for later in (2, 8):
        confirmation.judge(now + later * 1_000_000, ROUND)
        confirmation.note_frame(ID, reply(0.0), now + later * 1_000_000)
    assert not confirmation.judge(now + 3 * ROUND, ROUND) and not confirmation.may_send(), "after 7 ms"
    assert not confirmation.judge(now + 4 * ROUND, ROUND) and confirmation.may_send()


def test_rounds_may_follow_each_other_without_a_judgement():
    confirmation = confirming()
    for number in range(5):
        assert confirmation.may_send()
        confirmation.sent(number * ROUND, 2)


def test_after_late_replies_in_the_silence_round_and_silence_last_one_and_a_half_times_as_long_as_the_last_took():
    confirmation, now = in_the_silence()
    for later in (2_000_000, 7_100_000):  # 12.1 ms after its question
        confirmation.judge(now + later, ROUND)
        confirmation.note_frame(ID, reply(0.0), now + later)
    for later in (2, 3):
        assert not confirmation.may_send(), "there may be more"
        assert not confirmation.judge(now + later * ROUND, ROUND)
    assert confirmation.may_send()
    now += 3 * ROUND
    confirmation.sent(now, 2)
    for _ in range(2):
        confirmation.note_frame(ID, reply(0.0), now + 100_000)
    confirmed = [confirmation.judge(now + later * ROUND, ROUND) for later in range(1, 9)]
    assert confirmed == [False] * 7 + [True]  # 18.15 ms each, in steps of a round, and less a quarter of one


def test_a_silence_that_is_broken_again_and_again_ends():
    confirmation, now = in_the_silence()
    for later in range(1_000_000, 2 * STOP_LISTEN_LIMIT, 2_000_000):
        confirmation.note_frame(ID, reply(0.0), now + later)
        confirmation.judge(now + later, ROUND)
    assert not confirmation.confirmed and confirmation.may_send()


@pytest.mark.parametrize("arrival", [8_000_000, 9_900_000])
def test_replies_that_come_in_bursts_are_awaited_for_one_and_a_half_times_the_longest_gap(arrival):
    confirmation = confirming()
    waits = []
    for number in range(6):
        now = number * ROUND
        confirmation.judge(now, ROUND)
        waits.append(not confirmation.may_send())
        if confirmation.may_send():
            confirmation.sent(now, 2)
        for _ in range(4 * (number == 1)):  # to both rounds
            confirmation.note_frame(ID, reply(0.0), arrival)
    assert waits == [False, False, False, True, True, False]  # 10 + 12 ms, or 10 + 14.85 ms, less a quarter of a round


@pytest.mark.parametrize("torque, rests", [(0.0, True), (2.0, False)])
def test_a_frame_that_a_drive_also_sends_by_itself_is_no_reply_but_its_torque_counts(torque, rests):
    confirmation = StopConfirmation(StopReply(FRAMES[:1], unasked=FRAMES[1:], torque=TORQUE, rest=0.5))
    now = ask(confirmation, 2)
    assert not confirmation.judge(now, ROUND) and not confirmation.may_send()
    assert confirmation.note_frame(OTHER, reply(torque), now + 1_000_000) and confirmation.received == 4
    assert confirmation.judge(now + ROUND, ROUND) == rests


# Drives that report by themselves


def reported(confirmation, data, begin, count=1):
    """Reports, 1 ms apart, after a question at `begin`. Returns the time of the last."""
    confirmation.sent(begin, 1)
    for number in range(count):
        confirmation.note_frame(ID, data, begin + number * 1_000_000)
    return begin + (count - 1) * 1_000_000


@pytest.mark.parametrize("count", range(1, STOP_REPORTS + 2))
def test_an_echo_of_the_disable_confirms_after_consecutive_reports_at_rest(count):
    confirmation = confirming(reports=True, echo=ECHO)
    last = reported(confirmation, reply(0.0, ECHO[1]), 0, count)
    assert confirmation.judge(last, ROUND) == (count >= STOP_REPORTS)


@pytest.mark.parametrize("byte, confirms", [(0, False), (5, True)], ids=["nothing", "an error code"])
def test_without_an_echo_rest_confirms_only_if_an_error_code_is_in_its_place_and_it_lasts(byte, confirms):
    confirmation = confirming(reports=True, echo=ECHO)
    last = reported(confirmation, reply(0.0, byte), 0, STOP_REST // 1_000_000)
    assert not confirmation.judge(last, ROUND)
    assert confirmation.judge(STOP_REST, ROUND) == confirms


def test_an_error_code_that_has_gone_is_not_in_the_place_of_an_echo():
    confirmation = confirming(reports=True, echo=ECHO)
    reported(confirmation, reply(0.0, 5), 0, STOP_REST // 1_000_000)
    confirmation.note_frame(ID, reply(0.0), STOP_REST)
    assert not confirmation.judge(STOP_REST, ROUND)


def test_an_echo_from_before_a_torque_confirms_nothing():
    confirmation = confirming(reports=True, echo=ECHO)
    reported(confirmation, reply(0.0, ECHO[1]), 0)
    confirmation.note_frame(ID, reply(3.0, ECHO[1]), 1_000_000)
    last = reported(confirmation, reply(0.0), 2_000_000, STOP_REPORTS)
    assert not confirmation.judge(last, ROUND) and not confirmation.judge(last + STOP_REST, ROUND)
    assert confirmation.judge(reported(confirmation, reply(0.0, ECHO[1]), last + 1_000_000), ROUND)


def test_reports_from_before_the_first_round_confirm_nothing():
    confirmation = confirming(reports=True)
    for number in range(30):
        confirmation.note_frame(ID, reply(0.0), number * 1_000_000)
        assert not confirmation.judge(number * 1_000_000, ROUND)


def test_torque_between_reports_begins_the_rest_again():
    confirmation = confirming(reports=True)
    last = reported(confirmation, reply(0.0), 0, STOP_REST // 1_000_000)
    confirmation.note_frame(ID, reply(3.0), last + 1)
    reported(confirmation, reply(0.0), last + 1_000_000, 2)
    assert not confirmation.judge(last + 2_000_000, ROUND)
    assert confirmation.judge(last + 1_000_000 + STOP_REST, ROUND)
