"""Rig behind a microcontroller on a serial line, whose firmware stands in the folder `firmware`."""
