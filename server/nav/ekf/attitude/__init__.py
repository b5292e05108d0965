"""The nine-axis attitude mode: what the main lane publishes while nothing tells its position."""
