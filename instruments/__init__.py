"""Instruments, each a component and an FMU of its own (the rig's: Section 2.2 and Table 2.1).

Noise is an input, so that a seed outside decides it. Where the thesis prints no figure, the
parameter's source says what was assumed.
"""
