"""The Pareto front of design points: non-domination, constraints, the front, and the pick."""
