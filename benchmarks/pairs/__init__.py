"""Pairs of features, over scenes that are drawn round a motion that a vehicle can drive."""
