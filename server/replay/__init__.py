"""Recorded logs through the same engine as live: readers, lane files, scores, and their published contract."""
