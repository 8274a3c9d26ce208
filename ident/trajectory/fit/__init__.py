"""One fit of trajectories and parameters: its iteration, likelihoods and covariances."""
