"""Safety case: every measure is shown by a test, every mark names a measure, and the page is fresh."""

from tests.docs.safety_case import HAZARDS, PAGE, page, shown


def test_every_measure_is_shown_by_a_test_and_every_mark_names_a_measure():
    measures = {f"{hazard}{letter}" for hazard, (_, _, texts) in HAZARDS.items() for letter in texts}
    assert set(shown()) == measures


def test_safety_case_is_fresh():
    assert PAGE.read_text() == page()
