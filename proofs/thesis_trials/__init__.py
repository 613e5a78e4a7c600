"""What scatters in the thesis' tables of trials, and what its averaged friction curve costs."""
