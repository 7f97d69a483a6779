"""Models of the arm: nominal ones, and the checks of a controller's model."""
