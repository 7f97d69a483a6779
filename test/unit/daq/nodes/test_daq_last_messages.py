from __future__ import annotations

from flexarm_daq.nodes.recording import LastMessages, Timed

SECOND_NS = 1_000_000_000
NOW_NS = 1000 * SECOND_NS


def kept_of(count: int, *, reference_at: int = 0) -> LastMessages:
    """Return what is kept of messages once a second, with one set-point among them."""
    kept = LastMessages(60.0, {"reference"})
    for second in range(count):
        if second == reference_at:
            kept.add("reference", b"r", second * SECOND_NS)
        kept.add("state", str(second).encode(), second * SECOND_NS)
    return kept


def test_take___after_more_than_the_time___gives_the_last_of_it() -> None:
    states = [each for each in kept_of(200).take(NOW_NS) if each.topic == "state"]
    assert [each.time_ns // SECOND_NS for each in states] == list(range(139, 200))
    assert [each.raw for each in states] == [str(second).encode() for second in range(139, 200)]


def test_take___set_point_older_than_the_time___is_in_force_from_the_beginning() -> None:
    first, second, *_ = kept_of(200).take(NOW_NS)
    assert first == Timed("reference", b"r", 139 * SECOND_NS)
    assert second.topic == "state"


def test_take___set_point_within_the_time___has_its_own() -> None:
    found = [
        each for each in kept_of(200, reference_at=150).take(NOW_NS) if each.topic == "reference"
    ]
    assert found == [Timed("reference", b"r", 150 * SECOND_NS)]


def test_take___twice___gives_what_is_new_and_what_is_in_force() -> None:
    kept = kept_of(100, reference_at=90)
    assert len(kept) == 62
    kept.take(NOW_NS)
    assert kept.take(NOW_NS) == []
    kept.add("state", b"new", 100 * SECOND_NS)
    assert kept.take(NOW_NS) == [
        Timed("reference", b"r", 100 * SECOND_NS),
        Timed("state", b"new", 100 * SECOND_NS),
    ]


def test_add___clock_that_was_set_back___keeps_what_came() -> None:
    kept = kept_of(10)
    kept.add("state", b"back", -1000 * SECOND_NS)
    kept.add("state", b"next", -999 * SECOND_NS)
    assert len(kept.take(-999 * SECOND_NS)) == 13


def test_take___old_message_behind_a_younger_one___leaves_it_out() -> None:
    kept = LastMessages(60.0, {"reference"})
    kept.add("state", b"young", 50 * SECOND_NS)
    kept.add("reference", b"r", 10 * SECOND_NS)
    kept.add("reference", b"later", 20 * SECOND_NS)
    kept.add("state", b"newest", 100 * SECOND_NS)
    kept.add("command", b"late", 30 * SECOND_NS)
    assert kept.take(NOW_NS) == [
        Timed("reference", b"later", 50 * SECOND_NS),
        Timed("state", b"young", 50 * SECOND_NS),
        Timed("state", b"newest", 100 * SECOND_NS),
    ]
