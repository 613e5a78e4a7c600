"""The voltage that the axis is supplied with; numbers alone, so that they are soon there."""

UNLIMITED = 1e6
NOMINAL_VOLTAGE = 36.0  # Table 2.1 [V]
