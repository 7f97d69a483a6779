from setuptools import find_packages, setup

PACKAGE = "flexarm_bags"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    # Without a key of rosdep, so package.xml cannot name them.
    install_requires=["setuptools", "lz4>=4,<5", "mcap>=1.3,<2", "zstandard>=0.21,<1"],
    extras_require={"test": ["pytest"]},
    maintainer="flexarm maintainers",
    maintainer_email="flexarm@example.org",
    description="The rosbag2 format over MCAP: writing, reading, integrity checks, repair and playback.",
    license="Apache-2.0",
)
