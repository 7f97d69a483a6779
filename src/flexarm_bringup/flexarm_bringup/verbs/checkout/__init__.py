"""Verbs that need the checkout: tests, pages, benchmarks, reproduction."""
