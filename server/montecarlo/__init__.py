"""Monte Carlo on the demo board: many flights, each with other errors, and whether the filter's σ told the truth."""
