"""Plans of moves that leave the arm at rest: its flat model, the moves, friction while it moves."""
