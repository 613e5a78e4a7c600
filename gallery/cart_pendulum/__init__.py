"""A pendulum that is balanced on a cart with friction."""
