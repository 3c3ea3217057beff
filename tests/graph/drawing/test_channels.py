"""Tracks of lines that turn between two columns."""

from graph.drawing.channels import Wire, assign_tracks


def wire(left, right):
    return Wire(object(), set(left), set(right))


def test_a_straight_line_needs_no_track():
    straight = wire({10.0}, {10.0})
    assert assign_tracks([straight]) == 0 and straight.track == -1


def test_overlapping_lines_use_separate_tracks_and_others_share_one():
    above, below, over = wire({0.0}, {50.0}), wire({100.0}, {150.0}), wire({20.0}, {120.0})
    assert assign_tracks([above, below]) == 1
    assert above.track == below.track
    assign_tracks([above, below, over])
    assert over.track not in (above.track, below.track)


def test_entering_lines_turn_before_leaving_ones():
    first, second = wire({10.0}, {50.0}), wire({90.0}, {10.0})
    assign_tracks([second, first])
    assert first.track < second.track


def test_two_lines_that_change_places_are_drawn_with_one_of_them_on_two_tracks():
    down, up = wire({10.0}, {50.0}), wire({50.0}, {10.0})
    tracks = assign_tracks([down, up])
    split, whole = (down, up) if down.halves else (up, down)
    one, other = split.halves
    assert tracks == 3 and not whole.halves
    assert one.left == split.left and other.right == split.right and one.right == other.left
    (height,) = one.right
    assert all(abs(height - taken) >= 4.0 for taken in (10.0, 50.0))
    assert one.track < whole.track < other.track  # each turns off before the other turns on
