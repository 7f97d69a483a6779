"""Launch files, configuration and the flexarm command."""
