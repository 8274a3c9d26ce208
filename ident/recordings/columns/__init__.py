"""The columns file: a mapping from the columns of a log to joints, wrenches and the base."""
