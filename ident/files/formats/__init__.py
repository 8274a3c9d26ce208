"""Readers of other programs' files, one module for each format, into tables of named columns."""
