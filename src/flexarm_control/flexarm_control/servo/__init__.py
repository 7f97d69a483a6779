"""The law servo: a controller for any model, from its design to Python and C code."""
