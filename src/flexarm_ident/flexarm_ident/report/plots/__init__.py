"""Report plots as HTML.

Every plot is a pure function from numbers to text. Its lines stretch with the page and its words do
not, so that one text serves a wide window and a phone. Colours are those of the page's style sheet,
distinct to the colour-blind; line styles tell curves apart in black and white.
"""
