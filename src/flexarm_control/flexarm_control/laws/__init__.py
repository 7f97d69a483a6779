"""Control laws and their gains."""
