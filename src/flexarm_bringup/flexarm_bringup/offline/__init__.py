"""Work without nodes: files, identification, tuning."""
