"""Reproduction of the thesis: its tables, figures and claims beside our own, with verdicts.

`python -m reproduction`, which is the verb `reproduce`, runs what is asked for. The modules of the
chapters compute their subjects on the simulated rig, and `framework` runs and writes them.
"""
