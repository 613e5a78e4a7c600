"""Scatter in the thesis' tables of trials, and the error by its averaged friction curve."""
