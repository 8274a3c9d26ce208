"""How results look in an interpreter, a notebook and a data frame. Text, HTML, pandas and matplotlib are here alone."""
