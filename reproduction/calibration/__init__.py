"""Figures of the thesis that the rig of the study is calibrated by."""
