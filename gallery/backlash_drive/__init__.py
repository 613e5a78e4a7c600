"""A drive with backlash before its table, under the usual cascade."""
