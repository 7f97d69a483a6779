"""The thesis, reproduced: each of its tables and figures beside our own, and a verdict.

`subjects` says what a subject is, the modules of the chapters compute theirs on the simulated rig,
`run` runs what is asked for, and `document` writes it down.
"""
