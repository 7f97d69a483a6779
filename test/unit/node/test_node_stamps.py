from __future__ import annotations

from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st

from flexarm_node.stamps import set_stamp, stamp_ns


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_any_instant___is_kept_to_the_nanosecond(time_ns: int) -> None:
    stamp = Time()
    set_stamp(stamp, time_ns)
    assert 0 <= stamp.nanosec < 10**9
    assert stamp.sec == time_ns // 10**9
    assert stamp_ns(stamp) == time_ns
