"""Types whose members are known here, as a check of the definitions that a bag carries.

A bag's own definition says which bytes are which member. One that has two of them exchanged gives
a position for a speed, and nothing in the numbers tells. Members may be added or left out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_bags.schema import DefinitionError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosbags.highlevel import AnyReader
    from rosbags.interfaces.typing import Typesdict
    from rosbags.typesys.store import Typestore

OURS = {
    "flexarm_msgs/msg/ArmState": (
        "header",
        "sequence",
        "position_v",
        "base_strain_v",
        "middle_strain_v",
        "speed_v",
        "command_v",
        "compensation_v",
        "command_sequence",
    ),
    "flexarm_msgs/msg/MotorCommand": (
        "header",
        "sequence",
        "state_sequence",
        "effort_v",
        "compensation_v",
    ),
    "flexarm_msgs/msg/IoSample": (
        "header",
        "sequence",
        "inputs",
        "outputs",
        "compensations",
        "command_sequence",
    ),
    "flexarm_msgs/msg/IoCommand": (
        "header",
        "sequence",
        "sample_sequence",
        "efforts",
        "compensations",
    ),
}
"""Members of the types that carry samples and commands, in the order of their bytes."""


def require_known_order(reader: AnyReader, common: Typestore) -> None:
    """Refuse a bag that defines a known type with its members in another order.

    Parameters
    ----------
    reader : AnyReader
        The open bag.
    common : Typestore
        Types of ROS 2.

    Raises
    ------
    DefinitionError
        With the type and the members.
    """
    known = {**_members(common.fielddefs), **OURS}
    for name, found in _members(reader.typestore.fielddefs).items():
        complaint = exchanged(known.get(name, found), found)
        if complaint:
            raise DefinitionError(
                f"the bag's definition of {name} has {complaint} in another order than the known "
                "one: their values could be each other's; record with the right definition"
            )


def exchanged(known: Sequence[str], found: Sequence[str]) -> str:
    """Return the members that stand in another order, an empty text where none does."""
    common = [name for name in found if name in known]
    wanted = [name for name in known if name in found]
    return ", ".join(name for name, other in zip(common, wanted, strict=True) if name != other)


def _members(definitions: Typesdict) -> dict[str, tuple[str, ...]]:
    return {
        name: tuple(member for member, _ in content[1]) for name, content in definitions.items()
    }
