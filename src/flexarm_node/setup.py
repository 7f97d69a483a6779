from setuptools import find_packages, setup

PACKAGE = "flexarm_node"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    package_data={PACKAGE: ["loop_node.yaml", "profiles/*.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    maintainer="flexarm maintainers",
    maintainer_email="flexarm@example.org",
    description="What every node of flexarm shares: QoS, bounded parameters, signals, the fast path.",
    license="Apache-2.0",
)
