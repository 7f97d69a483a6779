from setuptools import find_packages, setup

PACKAGE = "flexarm_reproduction"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    package_data={PACKAGE: ["thesis/*.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    maintainer="flexarm maintainers",
    maintainer_email="flexarm@example.org",
    description="The tables and figures of the thesis beside our own.",
    license="Apache-2.0",
)
