"""Computations of a page in processes of their own, so that the server answers meanwhile."""
