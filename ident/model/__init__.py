"""The dynamic identification model: term by term, in closed form, and for many samples at once."""
