"""The way from a bag to a record: messages, instants, rows, and the kind of loop."""
