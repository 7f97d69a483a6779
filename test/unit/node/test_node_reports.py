"""Bytes of reports, beside those that rclpy makes of the same message."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from flexarm_node.reports import Level, Report, entries, report_bytes
from flexarm_node.stamps import set_stamp

TEXTS = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=30)


@given(
    level=st.sampled_from(Level),
    texts=st.tuples(TEXTS, TEXTS, TEXTS),
    values=st.dictionaries(TEXTS, st.one_of(TEXTS, st.integers(), st.floats()), max_size=12),
    now_ns=st.integers(0, 2**31 * 10**9 - 1),
)
def test_report___is_read_by_rclpy_as_it_was_written(
    level: Level, texts: tuple[str, str, str], values: dict[str, object], now_ns: int
) -> None:
    name, message, hardware_id = texts
    status = DiagnosticStatus(
        level=bytes([level]), name=name, message=message, hardware_id=hardware_id
    )
    status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    wanted = DiagnosticArray(status=[status])
    set_stamp(wanted.header.stamp, now_ns)

    raw = report_bytes(Report(level, message, entries(values)), name, hardware_id, now_ns)

    assert deserialize_message(raw, DiagnosticArray) == wanted
    # Theirs is not filled up at its end.
    assert 0 <= len(raw) - len(serialize_message(wanted)) < 4
