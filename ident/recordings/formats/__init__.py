"""Files that other programs write, each read by a library of its own into tables of named columns."""
