"""What every subject rests on: findings, computations kept on disk, the simulated rig, pages."""
