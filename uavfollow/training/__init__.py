"""Training as the command line offers it: run folders, data below one root, progress, what is said at the end."""
