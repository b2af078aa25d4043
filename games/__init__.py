"""Pure mathematics of dynamic games: dynamics, costs, equilibria, observation models."""
