from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "flexarm_bringup"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/config", [str(path) for path in Path("config").glob("*.*")]),
        (f"share/{PACKAGE}/config/sros2", [str(path) for path in Path("config/sros2").glob("*.*")]),
        (f"share/{PACKAGE}/urdf", [str(path) for path in Path("urdf").glob("*.*")]),
        (f"share/{PACKAGE}/launch", [str(path) for path in Path("launch").glob("*.launch.py")]),
        ("bin", ["bin/flexarm"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    maintainer="flexarm maintainers",
    maintainer_email="flexarm@example.org",
    description="Launch files, configuration and the flexarm command.",
    license="Apache-2.0",
    entry_points={"console_scripts": ["loop_node = flexarm_bringup.graph.loop_node:main"]},
)
