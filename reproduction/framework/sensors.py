"""The words for the four sensors on the pages, in the order of `flexarm_ident`'s `ARM_OUTPUTS`."""

SENSORS = ("position", "base gauge", "middle gauge", "speed")
