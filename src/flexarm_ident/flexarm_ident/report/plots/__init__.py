"""Report plots as SVG text.

Every plot is a pure function from numbers to SVG. It is narrow, so that a page can set two side by
side and a phone one below the other. Colours are distinct to the colour-blind, and line styles
tell curves apart in black and white.
"""
