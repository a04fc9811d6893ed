"""Everyday closed loops: scenes as a new user writes them, ground truth, baselines, contacts found between samples.

``scene`` describes a scene, ``scenes`` holds one file for each, ``loop`` drives one controller of ``controllers``
through it, ``truth`` plans the same trip with all motions known.
"""
