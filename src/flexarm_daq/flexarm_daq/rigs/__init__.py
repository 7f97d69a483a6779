"""Rigs: the simulated arm, a faulty one, a National Instruments board."""
