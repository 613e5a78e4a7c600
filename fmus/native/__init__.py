"""FMUs with compiled C that need no Python on the host; else equal to those of pythonfmu."""
