"""The rig behind a National Instruments board."""
