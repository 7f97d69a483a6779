"""Ground that every package stands on: channels, errors, parameter tables, array types."""
