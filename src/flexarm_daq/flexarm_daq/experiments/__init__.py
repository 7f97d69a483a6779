"""Experiments of the thesis and their excitation signals."""
