"""How fast, how accurate and how large in memory this is, beside other ways to do the same."""
