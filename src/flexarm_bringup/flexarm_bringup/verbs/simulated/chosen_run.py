"""Choice between nodes and one process for a run on the simulated arm."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_bringup.console.verb_group import is_of_ros

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from flexarm_bringup.verbs.simulated.simulated_run import RunSettings, SimulatedRun


def simulated_run(settings: RunSettings) -> AbstractContextManager[SimulatedRun]:
    """Make room for the results and start the laboratory: nodes, or one process without ROS 2.

    Raises
    ------
    OutputError
        When a result would replace something of somebody else.
    LaunchError
        When a node does not do its part, or the settings need nodes and there is no ROS 2.
    """
    settings.make_room()
    try:
        from flexarm_bringup.verbs.simulated.node_run import node_run  # noqa: PLC0415 - loads ROS
    except ModuleNotFoundError as error:
        if not is_of_ros(error.name or ""):
            raise
    else:
        return node_run(settings)
    from flexarm_bringup.verbs.simulated.one_process import one_process  # noqa: PLC0415

    return one_process(settings)
