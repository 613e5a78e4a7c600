"""Records of the axis in which an effect is hidden that no believed model has.

The proof of the diagnosis and its tests draw their records here.
"""
