"""The whole way from records to a validated, reduced model."""
