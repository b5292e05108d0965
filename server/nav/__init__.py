"""The numeric core: pure, no I/O, no clock."""
