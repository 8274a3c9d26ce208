"""The dynamic identification model: equation by equation, in closed form, and for many samples at once."""
