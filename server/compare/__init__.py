"""Lanes side by side on the very same samples: figures, a table, JSON, and one self-contained HTML report."""
