"""Synthetic friction laws, records of known friction, and random rigs with known parameters.

They are used by the proofs of the identification and of the features' criteria, and by their tests.
"""
