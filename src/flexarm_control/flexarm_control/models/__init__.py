"""Models of the arm: nominal ones, and what a controller asks of one."""
