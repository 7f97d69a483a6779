"""From records to an identified model, in memory or as a stream."""
