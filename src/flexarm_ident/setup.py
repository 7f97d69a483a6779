from setuptools import find_packages, setup

PACKAGE = "flexarm_ident"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(),
    package_data={
        PACKAGE: ["ident.yaml"],
        f"{PACKAGE}.report": ["templates/*.j2", "templates/*.js"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    # Without a key of rosdep, so package.xml cannot name them.
    install_requires=["setuptools", "control>=0.10.1,<0.11", "threadpoolctl>=3,<4"],
    extras_require={"test": ["pytest"]},
    maintainer="flexarm maintainers",
    maintainer_email="flexarm@example.org",
    description="Subspace identification, modal reduction, model updating and validation.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "ident_node = flexarm_ident.ident_node:main",
        ],
    },
)
