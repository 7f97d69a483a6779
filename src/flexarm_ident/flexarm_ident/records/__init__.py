"""The record of an experiment: inputs and outputs on an even grid, holes, preparation."""
