"""Independent checks of trips, for tests and benchmarks: they share no code with the package."""
