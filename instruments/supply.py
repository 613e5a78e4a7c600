"""The supply voltage of the axis; numbers only, so that importing is fast."""

UNLIMITED = 1e6
NOMINAL_VOLTAGE = 36.0  # Table 2.1 [V]
