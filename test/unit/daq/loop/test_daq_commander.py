from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexarm_core.signals import Command
from flexarm_daq.loop.commander import Commander, Verdict

NEWEST = 10_000


def following(*commands: Command) -> Commander:
    """Return a judge who has seen some commands."""
    commander = Commander()
    for command in commands:
        commander.judge(command, NEWEST)
    return commander


def command(sequence: int, sample: int, effort_v: float = 1.0, stamp_ns: int = 0) -> Command:
    return Command(sequence, sample, (effort_v,), (0.0,), stamp_ns)


@pytest.mark.parametrize(
    ("sequence", "sample", "verdict"),
    [
        (41, 101, Verdict.ACCEPTED),
        (41, 105, Verdict.ACCEPTED),  # it missed four samples
        (45, 105, Verdict.ACCEPTED),
        (46, 105, Verdict.FOREIGN),  # more commands than samples
        (40, 101, Verdict.FOREIGN),
        (1, 101, Verdict.FOREIGN),
        (39, 99, Verdict.OLD),
        (39, 97, Verdict.OLD),
        (38, 99, Verdict.FOREIGN),
        (41, 99, Verdict.FOREIGN),
        (41, 100, Verdict.CONFLICT),
        (41, NEWEST + 1, Verdict.AHEAD),
        (41, 0, Verdict.OLD),
    ],
)
def test_command___after_number_40_for_sample_100___is_judged(
    sequence: int, sample: int, verdict: Verdict
) -> None:
    assert following(command(40, 100)).judge(command(sequence, sample), NEWEST) is verdict


def test_command_in_turn___for_a_sample_too_old___is_late_and_changes_nothing() -> None:
    commander = following(command(40, 100))
    assert commander.judge(command(41, 101), NEWEST, in_time=False) is Verdict.LATE
    assert commander.answered == 100
    assert commander.judge(command(41, 101), NEWEST) is Verdict.ACCEPTED
    assert commander.verdicts == {Verdict.ACCEPTED: 2, Verdict.LATE: 1}


@pytest.mark.parametrize(
    ("sequence", "sample", "verdict"),
    [
        (46, 105, Verdict.FOREIGN),
        (39, 99, Verdict.OLD),
        (41, 100, Verdict.CONFLICT),
        (41, NEWEST + 1, Verdict.AHEAD),
    ],
)
def test_command_out_of_turn___for_a_sample_too_old___is_judged_as_ever(
    sequence: int, sample: int, verdict: Verdict
) -> None:
    commander = following(command(40, 100))
    assert commander.judge(command(sequence, sample), NEWEST, in_time=False) is verdict


def test_same_command_again___is_a_duplicate___with_another_stamp_a_conflict() -> None:
    commander = following(command(40, 100, stamp_ns=5))
    assert commander.judge(command(40, 100, stamp_ns=5), NEWEST) is Verdict.DUPLICATE
    assert commander.judge(command(40, 100, stamp_ns=6), NEWEST) is Verdict.CONFLICT


def test_silent_commander_released___another_takes_over___for_newer_samples_only() -> None:
    commander = following(command(40, 100))
    commander.release()
    assert commander.judge(command(1, 100), NEWEST) is Verdict.OLD
    assert commander.judge(command(1, 101), NEWEST) is Verdict.ACCEPTED
    assert commander.judge(command(41, 102), NEWEST) is Verdict.FOREIGN


def test_foreign_command___is_a_conflict_when_the_first_goes_on() -> None:
    commander = following(command(40, 100))
    assert commander.judge(command(1, 101), NEWEST) is Verdict.FOREIGN
    assert commander.judge(command(41, 102), NEWEST) is Verdict.CONFLICT


def test_answer_to_the_first_sample___again___is_judged_like_any_other() -> None:
    commander = following(command(1, 1))
    assert commander.judge(command(1, 1), NEWEST) is Verdict.DUPLICATE
    assert commander.judge(command(1, 1, effort_v=2.0), NEWEST) is Verdict.CONFLICT


def test_foreign_command___is_no_conflict_when_the_first_has_gone() -> None:
    commander = following(command(40, 100), command(1, 101))
    commander.release()
    assert commander.judge(command(2, 102), NEWEST) is Verdict.ACCEPTED


@pytest.mark.parametrize("sequence", [0, 7])
@pytest.mark.parametrize("patience", [1, 2, 3])
def test_sender_that_does_not_count___drives_with_its_first_command_alone(
    sequence: int, patience: int
) -> None:
    """Whether it is slow, and silent after each command, or as fast as the samples."""
    commander = Commander()
    verdicts = []
    for sample in range(1, 100):
        verdicts.append(commander.judge(command(sequence, sample), sample))
        if sample % patience == 0:
            commander.release()
    assert verdicts == [Verdict.ACCEPTED, *[Verdict.FOREIGN] * 98]
    # Mended and started anew, it is obeyed from its second command on.
    verdicts = [commander.judge(command(50 + n, 100 + n), 100 + n) for n in range(1, 4)]
    assert verdicts == [Verdict.FOREIGN, Verdict.ACCEPTED, Verdict.ACCEPTED]


def test_commander_after_one_that_did_not_count___is_not_asked_for_it_again() -> None:
    commander = following(command(7, 1), command(7, 2))
    commander.release()
    found = [commander.judge(command(n, 10 + n), NEWEST) for n in (1, 2, 3)]
    assert found == [Verdict.FOREIGN, Verdict.ACCEPTED, Verdict.ACCEPTED]
    commander.release()
    assert commander.judge(command(1, 50), NEWEST) is Verdict.ACCEPTED


def test_commander_that_sent_one_command___started_again___drives_with_its_second() -> None:
    commander = following(command(1, 1))
    commander.release()
    found = [commander.judge(command(n, 10 + n), NEWEST) for n in (1, 2, 3)]
    assert found == [Verdict.FOREIGN, Verdict.ACCEPTED, Verdict.ACCEPTED]


@given(st.lists(st.tuples(st.integers(1, 4), st.booleans()), min_size=1, max_size=50))
def test_one_commander___that_misses_samples_and_loses_commands___is_always_accepted(
    steps: list[tuple[int, bool]],
) -> None:
    commander = Commander()
    sequence = sample = 0
    for samples, is_lost in steps:
        sequence, sample = sequence + 1, sample + samples
        if not is_lost:
            assert commander.judge(command(sequence, sample), sample) is Verdict.ACCEPTED


@given(
    st.integers(0, 1000),
    st.integers(0, 1000),
    st.lists(st.booleans(), min_size=6, max_size=40),
)
def test_two_commanders___both_answering___are_found_within_three_samples(
    offset: int, other_offset: int, order: list[bool]
) -> None:
    """Whatever their counts, and whoever is first each time."""
    commander = Commander()
    verdicts = []
    for sample, is_swapped in enumerate(order[:3], start=1):
        pair = [command(offset + sample, sample, 1.0), command(other_offset + sample, sample, -1.0)]
        ordered = pair[::-1] if is_swapped else pair
        verdicts += [commander.judge(each, sample) for each in ordered]
    assert Verdict.CONFLICT in verdicts


RELEASE = None
HISTORIES = st.lists(
    st.one_of(
        st.just(RELEASE),
        st.tuples(st.integers(0, 6), st.integers(0, 3), st.sampled_from([True, True, True, False])),
    ),
    max_size=40,
)


class _Rule:
    """The rule of docs/safety.md, from all that has happened: an independent route."""

    def __init__(self) -> None:
        self.obeyed = command(-1, 0)
        self.refused: list[Command] = []
        self.is_in_force = False
        self.ends: set[int] = set()
        """First and last numbers of all reigns."""

    def silence(self) -> None:
        if self.is_in_force:
            self.ends.add(self.obeyed.sequence)
        self.is_in_force = False

    def verdict(self, asked: Command, newest: int) -> Verdict:
        """Return what the rule says of a command that is in time."""
        if asked.state_sequence > newest:
            return Verdict.AHEAD
        if self.is_in_force:
            return self._beside(asked)
        if asked.state_sequence <= self.obeyed.state_sequence:
            return Verdict.OLD
        is_new = asked.sequence not in self.ends
        counts = not self.refused or _of_one(self.refused[-1], asked)
        return Verdict.ACCEPTED if counts and is_new else Verdict.FOREIGN

    def _beside(self, asked: Command) -> Verdict:
        if asked.state_sequence == self.obeyed.state_sequence:
            return Verdict.DUPLICATE if asked == self.obeyed else Verdict.CONFLICT
        if not _of_one(self.obeyed, asked):
            return Verdict.FOREIGN
        if asked.state_sequence < self.obeyed.state_sequence:
            return Verdict.OLD
        return Verdict.CONFLICT if self.refused else Verdict.ACCEPTED

    def note(self, asked: Command, verdict: Verdict) -> None:
        """Take note of a verdict."""
        if verdict is Verdict.ACCEPTED:
            if not self.is_in_force:
                self.ends.add(asked.sequence)
            self.obeyed, self.refused, self.is_in_force = asked, [], True
        if verdict is Verdict.FOREIGN:
            self.refused.append(asked)


def _of_one(one: Command, other: Command) -> bool:
    """Return whether one sender that numbers its answers can have sent both."""
    first, second = sorted((one, other), key=lambda each: each.state_sequence)
    samples = second.state_sequence - first.state_sequence
    return first.sequence + 1 <= second.sequence <= first.sequence + samples


@given(HISTORIES)
def test_any_commands_silences_and_refusals___are_judged_by_the_rule(
    history: list[tuple[int, int, bool] | None],
) -> None:
    commander, rule, sample = Commander(), _Rule(), 1
    for event in history:
        if event is RELEASE:
            commander.release()
            rule.silence()
            continue
        number, samples, in_time = event
        sample += samples
        asked = command(number, max(sample - (number == 3), 1))
        expected = rule.verdict(asked, sample)
        late = expected in {Verdict.ACCEPTED, Verdict.CONFLICT} and not in_time
        if late and asked.state_sequence > rule.obeyed.state_sequence:
            expected = Verdict.LATE
        assert commander.judge(asked, sample, in_time=in_time) is expected
        if expected is Verdict.CONFLICT:
            return  # the drive is held, and nothing drives any more
        rule.note(asked, expected)


@given(HISTORIES, st.integers(0, 7), st.lists(st.tuples(st.integers(1, 3), st.integers(0, 2))))
def test_one_number_again_and_again___after_whatever_was___is_obeyed_once(
    history: list[tuple[int, int, bool] | None], number: int, tail: list[tuple[int, int]]
) -> None:
    commander, sample = Commander(), 1
    for event in history:
        if event is RELEASE:
            commander.release()
        else:
            sample += event[1]
            commander.judge(command(event[0], sample), sample, in_time=event[2])
    verdicts = []
    for samples, releases in tail:
        sample += samples
        verdicts.append(commander.judge(command(number, sample), sample))
        for _ in range(releases):
            commander.release()
    assert verdicts.count(Verdict.ACCEPTED) <= 1


def test_refused_number_that_counted_on___again_after_silences___is_obeyed_once() -> None:
    commander = Commander()
    verdicts = []
    for sample, number in enumerate([5, 5, 6, 6, 6, 6, 6], start=1):
        verdicts.append(commander.judge(command(number, sample), sample))
        if sample in {1, 3}:
            commander.release()
    foreign, accepted = Verdict.FOREIGN, Verdict.ACCEPTED
    assert verdicts == [accepted, foreign, accepted, foreign, foreign, foreign, foreign]
    commander.release()
    assert commander.judge(command(6, 8), 8) is foreign


def test_two_silences_in_a_row___the_same_number___is_not_obeyed_again() -> None:
    commander = following(command(7, 1))
    commander.release()
    commander.release()
    assert commander.judge(command(7, 10), NEWEST) is Verdict.FOREIGN


@pytest.mark.parametrize("circle", [(5, 6), (6, 5), (1, 2, 3), (9, 4, 7, 4)])
@pytest.mark.parametrize("silences", [1, 2])
def test_numbers_in_a_circle___with_silences_between___are_obeyed_once_each(
    circle: tuple[int, ...], silences: int
) -> None:
    commander, obeyed = Commander(), []
    for sample in range(1, 400):
        number = circle[sample % len(circle)]
        if commander.judge(command(number, 3 * sample), 3 * sample) is Verdict.ACCEPTED:
            obeyed.append(number)
        for _ in range(silences):
            commander.release()
    assert sorted(obeyed) == sorted(set(obeyed))


@given(st.lists(st.integers(1, 50), min_size=1, max_size=20))
def test_commander_started_again_and_again___is_obeyed_a_command_later_each_time_at_most(
    lengths: list[int],
) -> None:
    commander, sample = Commander(), 0
    for starts, length in enumerate(lengths):
        verdicts = []
        for number in range(1, length + 1):
            sample += 1
            verdicts.append(commander.judge(command(number, sample), sample))
        commander.release()
        refused = verdicts.count(Verdict.FOREIGN)
        assert verdicts == [Verdict.FOREIGN] * refused + [Verdict.ACCEPTED] * (length - refused)
        # The first and the last number of each reign before it.
        assert refused <= 2 * starts


@pytest.mark.parametrize("between", [(41, 90), (41, NEWEST + 1)], ids=["old", "ahead"])
def test_refused_sender___whose_next_command_acts_on_no_sample___still_has_to_count_on(
    between: tuple[int, int],
) -> None:
    commander = following(command(40, 100))
    commander.release()
    for each in ((40, 105), between):
        commander.judge(command(*each), NEWEST)
    assert commander.judge(command(60, 107), NEWEST) is Verdict.FOREIGN
    assert commander.judge(command(61, 108), NEWEST) is Verdict.ACCEPTED
