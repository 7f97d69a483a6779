from __future__ import annotations

import pytest

from flexarm_daq.nodes.recording import SendTimes

MS = 1_000_000
HOUR = 3_600_000 * MS
STEADY = 50_000 * MS
"""The steady clock of the recorder at the stop."""
RECEIVED = STEADY + 200 * MS


def heard(offsets: list[int], delays_ms: list[float]) -> SendTimes:
    """Return what a recorder knows that heard a message every 2 ms until the stop.

    The sender's clock is ahead of the steady one by these offsets.
    """
    times = SendTimes()
    for k, (offset, delay_ms) in enumerate(zip(offsets, delays_ms, strict=True)):
        sent = STEADY - 2 * MS * (len(offsets) - k)
        times.add(sent + offset, sent + round(delay_ms * MS))
    return times


@pytest.mark.parametrize("offset", [0, 1_700_000_000_000 * MS, HOUR, -HOUR])
def test_message___sent_before_or_after_the_stop___is_reported_for_any_clock(offset: int) -> None:
    times = heard([offset] * 100, [0.3 + 5.0 * (k % 7) for k in range(100)])
    for before_ms in (0.4, 1.0, 100.0):
        assert times.was_sent_before(STEADY - round(before_ms * MS) + offset, STEADY, RECEIVED)
    for after_ms in (0.1, 1.0, 100.0):
        assert not times.was_sent_before(STEADY + round(after_ms * MS) + offset, STEADY, RECEIVED)


@pytest.mark.parametrize("step", [HOUR, -HOUR])
def test_clock___set_while_recording___does_not_decide(step: int) -> None:
    times = heard([0] * 300 + [step] * 300, [0.3] * 600)
    assert times.was_sent_before(STEADY - MS + step, STEADY, RECEIVED)
    assert not times.was_sent_before(STEADY + MS + step, STEADY, RECEIVED)


def test_messages___to_a_recorder_that_is_behind___were_sent_before_the_stop() -> None:
    # Each of the last 2000 messages was read later than the one before it, 2 s at last.
    times = heard([0] * 5000, [0.3] * 3000 + [float(k) for k in range(2000)])
    for before_ms in (0.4, 500.0, 1900.0):
        assert times.was_sent_before(STEADY - round(before_ms * MS), STEADY, RECEIVED)
    assert not times.was_sent_before(STEADY + MS, STEADY, RECEIVED)


def test_first_message_of_a_sender___counts_as_sent_before() -> None:
    assert SendTimes().was_sent_before(2**62, STEADY, RECEIVED)


@pytest.mark.parametrize("sent_ms", [-2000.0, -1.0, 1.0])
def test_message___of_a_clock_that_was_set_forward_unheard___is_kept(sent_ms: float) -> None:
    # Nothing of the new clock had been read before the stop.
    times = heard([0] * 300, [0.3] * 300)
    assert times.was_sent_before(STEADY + round(sent_ms * MS) + HOUR, STEADY, RECEIVED)
