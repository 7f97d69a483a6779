"""Bridge from the graph to a page in the browser and to the terminal."""
