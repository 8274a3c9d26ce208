"""Reports: the tables, figures and texts that show what a command computed."""
