from setuptools import find_packages, setup

PACKAGE = "flexarm_core"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    package_data={PACKAGE: ["rigs/*.yaml", "rigs/packaged/*.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    maintainer="flexarm maintainers",
    maintainer_email="flexarm@example.org",
    description="Ground that every package stands on: channels, errors, parameter tables, array types.",
    license="Apache-2.0",
)
