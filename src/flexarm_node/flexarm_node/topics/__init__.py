"""Topics of the nodes with a loop: waited on outside the executor, packed without messages."""
