from setuptools import find_packages, setup

PACKAGE = "flexarm_live"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    package_data={PACKAGE: ["foxglove.yaml", "live.yaml", "page/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    # Without a key of rosdep, or with one that is too old on the oldest system.
    install_requires=["setuptools", "control>=0.10.1,<0.11", "websockets>=14,<18"],
    extras_require={"test": ["pytest"]},
    maintainer="flexarm maintainers",
    maintainer_email="flexarm@example.org",
    description="Bridge from the graph to a page in the browser and to the terminal.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "foxglove_node = flexarm_live.foxglove_node:main",
            "live_node = flexarm_live.live_node:main",
        ]
    },
)
