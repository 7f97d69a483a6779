"""Notebook views of results: tables, and curves to draw on."""
