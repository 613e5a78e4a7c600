"""FMUs that hold compiled C and need no Python on the host, twins of those that pythonfmu makes."""
