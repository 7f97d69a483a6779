"""Framework of the study: findings, computations that are kept, the simulated rig, the pages."""
