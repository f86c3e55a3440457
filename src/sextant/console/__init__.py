"""Parts shared by commands: arguments, terminal output, output folders."""
