"""Synthetic friction laws, records of known friction, and random rigs with known parameters.

They are used by the proof of the identification and by its tests.
"""
