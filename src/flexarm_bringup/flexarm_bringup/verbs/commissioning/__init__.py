"""Verb commission: an unknown arm measured, modelled and controlled."""
