"""`navdeck calibrate`: the live collectors on files. What it reads and writes is in CONTRACT.md."""
