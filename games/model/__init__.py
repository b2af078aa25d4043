"""What a game is: players, dynamics, costs, constraints, unknowns, and how it is seen."""
