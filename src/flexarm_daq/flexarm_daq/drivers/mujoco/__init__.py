"""Rig in MuJoCo: any arm of a MJCF or URDF file, and two that come with flexarm."""
