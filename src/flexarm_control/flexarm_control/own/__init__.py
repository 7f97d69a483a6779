"""Laws of the user's own."""
