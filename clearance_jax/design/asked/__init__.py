"""What is asked: variables, limits, conditions, costs, models of manufacture."""
