"""A game as compiled functions: derivatives by CasADi, linear algebra in C."""
