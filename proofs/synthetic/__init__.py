"""Made-up friction laws, records of known friction, and random rigs whose parameters are known.

The proofs of the identification and of the features' criteria, and their tests, draw them here.
"""
