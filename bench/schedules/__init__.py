"""Fault schedules: the whole graph in one process, in virtual time, by a seed."""
