"""Base parameters that a mechanism's sensors identify, priors, and physically consistent full parameters."""
