from __future__ import annotations

from flexarm_ident.records.naming import portable_names, short_names


def test_short_names___path_with_a_long_remark___is_the_files_name() -> None:
    label = "/data/rigs/left/2024/run_7 (simulated rig, payload 0 g, seed 3, and more)"
    assert short_names([label]) == {label: "run_7"}


def test_short_names___same_name_in_two_folders___take_the_folder_as_well() -> None:
    labels = ["out/first/bag (a)", "out/second/bag (b)", "out/second/rest"]
    assert list(short_names(labels).values()) == ["first/bag", "second/bag", "second/rest"]


def test_short_names___same_path_with_two_remarks___are_whole() -> None:
    labels = ["run (morning)", "run (evening)"]
    assert list(short_names(labels).values()) == labels


def test_short_names___words___stay() -> None:
    assert short_names(["record", "run 3", "record"]) == {"record": "record", "run 3": "run 3"}


def test_portable_names___absolute_paths_alone___lose_their_folders() -> None:
    assert portable_names(["/home/ann/bags/run_7", "bags/run_8"]) == ["run_7", "bags/run_8"]
    assert portable_names(["/a/bags/run (two parts)"]) == ["run"]
    assert portable_names(["/a/x/run", "/a/y/run"]) == ["x/run", "y/run"]
    assert portable_names(["/a/run", "/a/run"]) == ["run", "run"]
    assert portable_names(["record"]) == ["record"]
