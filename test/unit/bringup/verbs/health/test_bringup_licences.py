from __future__ import annotations

from importlib.metadata import PathDistribution, version
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flexarm_bringup.verbs.health.doctor import UNSTATED, Licensed, doctor, licence_name, summary

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    ("fields", "licence"),
    [
        ("License-Expression: BSD-3-Clause\nLicense: something else", "BSD-3-Clause"),
        (
            "Classifier: License :: OSI Approved :: Apache Software License\nLicense: old",
            "Apache Software License",
        ),
        (
            "Classifier: License :: OSI Approved :: A\nClassifier: License :: OSI Approved :: B",
            "A, B",
        ),
        ("Classifier: License :: OSI Approved\nLicense: MIT", "MIT"),
        ("License: Apache License, Version 2.0", "Apache License, Version 2.0"),
        ("License: Copyright (c) somebody\n        All rights reserved in many lines", UNSTATED),
        ("License: UNKNOWN", UNSTATED),
        ("Classifier: Topic :: Scientific", UNSTATED),
    ],
)
def test_licence___is_what_the_package_states(tmp_path: Path, fields: str, licence: str) -> None:
    folder = tmp_path / "some-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text(f"Metadata-Version: 2.4\nName: some\nVersion: 1.0\n{fields}\n")
    assert licence_name(PathDistribution(folder).metadata) == licence


def test_licence___of_a_wheel_of_ros___is_that_of_its_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "ros_jazzy_some_msgs-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.4\nName: ros-jazzy-some-msgs\n")
    share = tmp_path / "share" / "some_msgs"
    share.mkdir(parents=True)
    (share / "package.xml").write_text('<license file="L">BSD</license><license> MIT </license>')
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    assert licence_name(PathDistribution(folder).metadata) == "BSD, MIT"


def test_doctor___licences___lists_every_package_with_its_version() -> None:
    result = CliRunner().invoke(doctor, ["--licences"])
    assert result.exit_code == 0, result.output
    lines = {line.split()[0]: line.split()[1] for line in result.output.splitlines()[:-1]}
    for name in ("numpy", "rosbags", "mcap", "lz4"):
        assert lines[name] == version(name)
    assert not any(name.startswith("flexarm") for name in lines)


def test_summary___names_the_packages_without_a_licence() -> None:
    rows = [Licensed("a", "1", "MIT"), Licensed("b", "2", UNSTATED)]
    assert summary(rows) == "1 package without a stated licence: b"
    assert summary(rows[:1]) == "every package states its licence"
