"""Quality of service of flexarm's topics, in one place, so that both ends match."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _reliable(depth: int, durability: DurabilityPolicy = DurabilityPolicy.VOLATILE) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=durability,
    )


SENT = _reliable(10000)
"""Samples and commands as published: kept so long that a reader whose process pauses loses none."""

NEWEST = _reliable(1)
"""For a reader that only ever wants the newest message: the loop's two ends."""

SEEN = QoSProfile(
    depth=1000,
    history=HistoryPolicy.KEEP_LAST,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
"""For a viewer of samples: its writer neither waits for it nor repeats anything."""

RECORDED = QoSProfile(
    history=HistoryPolicy.KEEP_ALL,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""For the recorder: what it has not read is not acknowledged, and waited for in virtual time."""

EVERY = _reliable(10000)
"""For a reader that must see every message although its process pauses: the recorder."""

CALLS = _reliable(1000)
"""For a service or an action with long work: calls that come at once are all answered."""

STATUS = _reliable(1, DurabilityPolicy.TRANSIENT_LOCAL)
"""For what a latecomer must still get: channel names, the reference in force."""

STATUS_SENT = _reliable(1000, DurabilityPolicy.TRANSIENT_LOCAL)
"""Such a topic as published when each change counts: a lost message is repeated, also when the next
one is there already. A latecomer that reads it as `STATUS` ends with the newest."""
