"""Model reduction: modal rankings, updating, balanced truncation."""
