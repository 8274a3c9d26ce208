"""The trajectory estimator: motion, parameters, set-up and noise estimated together."""
