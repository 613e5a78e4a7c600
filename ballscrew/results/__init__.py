"""What the public functions return, a file for each: a command imports only its own."""
