from setuptools import find_packages, setup

PACKAGE = "flexarm_control"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    package_data={
        PACKAGE: ["controller.yaml"],
        f"{PACKAGE}.models": ["*.yaml", "identified/*.yaml", "rig/*.yaml"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    # Without a key of rosdep, so package.xml cannot name them.
    install_requires=["setuptools", "control>=0.10.1,<0.11"],
    extras_require={"test": ["pytest"]},
    maintainer="flexarm maintainers",
    maintainer_email="flexarm@example.org",
    description="Control laws, margins and the controller node.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "controller_node = flexarm_control.controller_node:main",
            "tuner_node = flexarm_control.tuner_node:main",
        ],
        "flexarm.rigs": ["twin = flexarm_control.twin:TwinRig"],
    },
)
