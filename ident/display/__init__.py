"""Results as text, HTML for notebooks, data frames and plots; pandas and matplotlib are imported here alone."""
