from __future__ import annotations

from flexarm_daq.nodes.recording import KeptMessages


def written(
    kept: KeptMessages, topic: str, raw: bytes, time_ns: int
) -> list[tuple[str, bytes, int]]:
    return list(kept.due(topic, raw, time_ns))


def test_bag_begun_later___has_the_last_one_before_anything_else() -> None:
    kept = KeptMessages(["who"])
    written(kept, "who", b"old", 1)
    written(kept, "who", b"new", 2)
    kept.open(100)
    assert written(kept, "state", b"s", 105) == [("who", b"new", 100), ("state", b"s", 105)]
    assert written(kept, "state", b"t", 106) == [("state", b"t", 106)]


def test_newer_one_that_comes_first___stands_alone() -> None:
    kept = KeptMessages(["who"])
    written(kept, "who", b"old", 1)
    kept.open(100)
    assert written(kept, "who", b"new", 103) == [("who", b"new", 103)]
    assert written(kept, "state", b"s", 105) == [("state", b"s", 105)]


def test_one_that_was_sent_before_the_bag___has_the_time_of_its_beginning() -> None:
    kept = KeptMessages(["who"])
    kept.open(100)
    assert written(kept, "who", b"old", 1) == [("who", b"old", 100)]


def test_every_bag___has_it() -> None:
    kept = KeptMessages(["who"])
    written(kept, "who", b"x", 1)
    for begun_ns in (100, 200):
        kept.open(begun_ns)
        assert written(kept, "state", b"s", 300)[0] == ("who", b"x", begun_ns)
