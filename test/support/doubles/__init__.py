"""Doubles of packages by the names of those: modules to import, and a folder for a node's path."""
