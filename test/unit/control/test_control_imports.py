"""Test that a controller's process loads nothing that takes long."""

from support.loaded_modules import loaded


def test_import_of_the_node__slow_libraries___wait_until_they_are_needed() -> None:
    slow = "control matplotlib numba scipy.linalg scipy.optimize scipy.signal scipy.stats"
    assert not loaded("flexarm_control.controller_node", slow)
