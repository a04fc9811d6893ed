"""Hostile input: what is damaged, absurd or wild but legal, and what the package makes of it."""
