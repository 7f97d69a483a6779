"""Records of experiments: inputs and outputs on an even grid, holes, preparation."""
