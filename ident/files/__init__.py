"""Files of numbers as tables with named columns, of every format that is read or written."""
