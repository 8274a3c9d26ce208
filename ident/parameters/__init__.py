"""Which parameters a mechanism's sensors can see, and the physical bodies that have them."""
