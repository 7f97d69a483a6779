"""The page on parameters has the tables that the nodes declare, also as it lies in a checkout."""

from __future__ import annotations

from importlib.util import module_from_spec, spec_from_file_location

from support.project import PROJECT


def test_page_on_parameters___has_the_tables_of_the_nodes() -> None:
    spec = spec_from_file_location("parameter_tables", PROJECT / "docs" / "parameter_tables.py")
    assert spec is not None
    assert spec.loader is not None
    tables = module_from_spec(spec)
    spec.loader.exec_module(tables)
    page = tables.PAGE.read_text("utf-8")
    assert page.count("| `rate_hz` |") > 0
    assert page == tables.with_tables(page), "run ./flexarm exec python docs/parameter_tables.py"
