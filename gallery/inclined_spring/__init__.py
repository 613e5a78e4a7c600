"""A mass on a surface, pulled at constant velocity over a spring that may be inclined."""
