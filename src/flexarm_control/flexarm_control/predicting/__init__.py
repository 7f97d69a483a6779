"""Prediction of the signals of a loop, and the least correction that keeps one within a limit."""
