from setuptools import find_packages, setup

PACKAGE = "flexarm_daq"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    package_data={
        f"{PACKAGE}.drivers.mujoco": ["*.xml"],
        f"{PACKAGE}.experiments": ["catalogue.yaml"],
        f"{PACKAGE}.nodes": ["*.yaml"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={
        "mujoco": ["mujoco>=3.3,<5"],
        "nidaq": ["nidaqmx>=1.0,<2"],
        "test": ["pytest"],
    },
    maintainer="flexarm maintainers",
    maintainer_email="flexarm@example.org",
    description="The rig: beam and motor simulation, DAQ driver node, recording and replay.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "daq_node = flexarm_daq.nodes.daq_node:main",
            "experiment_node = flexarm_daq.nodes.experiment_node:main",
            "recorder_node = flexarm_daq.nodes.recorder_node:main",
            "player_node = flexarm_daq.nodes.player_node:main",
        ],
    },
)
