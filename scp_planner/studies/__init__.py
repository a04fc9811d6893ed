"""The published claims, and this package's own promises, measured."""
