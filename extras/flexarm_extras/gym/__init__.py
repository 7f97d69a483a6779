"""Environments of Gymnasium: a policy learns on the simulated arm.

Importing this package registers `flexarm/Arm-v0`::

    import gymnasium
    import flexarm_extras.gym
    arm = gymnasium.make("flexarm/Arm-v0")
    arms = gymnasium.make_vec("flexarm/Arm-v0", num_envs=1024)
"""

from importlib.util import find_spec

if find_spec("gymnasium") is None:
    raise ModuleNotFoundError(
        "flexarm_extras.gym needs gymnasium: pip install -r requirements/gym.in, or "
        'pip install "./flexarm[gym]"',
        name="gymnasium",
    )

from gymnasium.envs.registration import register

from flexarm_extras.gym.arm_env import ArmEnv, ArmVectorEnv
from flexarm_extras.gym.task import SensorFault, Task

__all__ = ["ArmEnv", "ArmVectorEnv", "SensorFault", "Task"]

register(
    "flexarm/Arm-v0",
    entry_point="flexarm_extras.gym.arm_env:ArmEnv",
    vector_entry_point="flexarm_extras.gym.arm_env:ArmVectorEnv",
)
