"""Appendices: the experiments of the thesis, and the models that it prints."""
