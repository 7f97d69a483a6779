"""The parts that sections of the report are made of."""
