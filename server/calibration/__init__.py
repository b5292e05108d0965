"""Calibration as the server owns it: jobs, the store of sets with their history, exchange with other formats."""
