"""Extras on top of the packages: many simulated rigs at once, and policies that learn on them."""
