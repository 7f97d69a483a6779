"""Terminal of the user, and the command's groups of verbs."""
