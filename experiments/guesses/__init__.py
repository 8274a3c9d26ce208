"""Guesses at the columns of a log, from names, numbers and the predictions of the model."""
