"""Pages, and the programs that draw, run and build them."""
