"""Control laws, margins and the controller node."""
